"""What the UDP sockets of DDS hold, asked of real sockets of this process."""

import contextlib
import socket
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from ros2_kafka_bridge.ros import sockets
from ros2_kafka_bridge.ros.sockets import receive_buffer_bytes

DOMAIN = 3
OPEN = Path('/proc/self/fd')


def open_files() -> Counter[str]:
    """What is open in this process: less in a moment, where others of it let something go."""
    found: Counter[str] = Counter()
    for one in OPEN.iterdir():
        with contextlib.suppress(FileNotFoundError):
            found[str(one.readlink())] += 1
    return found


@pytest.fixture
def listening(monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """A UDP socket on a port of the domain."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as found:
        found.bind(('127.0.0.1', 0))
        own_first = found.getsockname()[1] - 250 * DOMAIN - 11
        monkeypatch.setattr(sockets, '_FIRST_PORT', own_first)
        yield found


def test_the_room_of_a_socket_that_listens_in_the_domain_is_told(listening: socket.socket) -> None:
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 30_000)
    # Linux takes twice as much, for what it notes of each packet.
    assert receive_buffer_bytes(DOMAIN) == 60_000
    assert receive_buffer_bytes(DOMAIN + 100) is None


def test_a_look_leaves_no_file_open(listening: socket.socket) -> None:
    assert listening.fileno() > 0
    before = open_files()
    receive_buffer_bytes(DOMAIN)
    assert not open_files() - before


def test_where_the_system_does_not_tell_nothing_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sockets, '_FILES', Path('/nowhere'))
    assert receive_buffer_bytes(DOMAIN) is None
