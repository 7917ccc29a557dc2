"""Answers of a Schema Registry that end late or never, and what the formats say of answers."""

import contextlib
import socket
import threading
import time
import zlib
from collections.abc import Callable, Iterator
from typing import Any, Final

import pytest
from support.formats.avro import ROBOT, scope_of

from ros2_kafka_bridge.errors import BridgeError
from ros2_kafka_bridge.formats.avro import make_decode, make_encode

Answer = Callable[[socket.socket], object]

_HEAD: Final = b'HTTP/1.1 200 OK\r\nContent-Type: application/json\r\n'


@contextlib.contextmanager
def answering(answer: Answer) -> Iterator[str]:
    """Let `answer` answer each request, of which it is shown the connection; gives the URL."""
    with socket.create_server(('127.0.0.1', 0)) as listener:
        threading.Thread(target=_serve, args=(listener, answer), daemon=True).start()
        yield f'http://127.0.0.1:{listener.getsockname()[1]}'
        listener.shutdown(socket.SHUT_RDWR)


def _serve(listener: socket.socket, answer: Answer) -> None:
    with contextlib.suppress(OSError):
        while True:
            connection, _ = listener.accept()
            threading.Thread(target=_answer, args=(connection, answer), daemon=True).start()


def _answer(connection: socket.socket, answer: Answer) -> None:
    with contextlib.suppress(OSError), connection:
        connection.recv(65_536)
        answer(connection)


def blanks_as_gzip(connection: socket.socket) -> None:
    """300 MB of blanks, in 300 kB."""
    packer = zlib.compressobj(1, wbits=16 + zlib.MAX_WBITS)
    body = b''.join([*(packer.compress(b' ' * 1_000_000) for _ in range(300)), packer.flush()])
    head = _HEAD + b'Content-Encoding: gzip\r\nContent-Length: %d\r\n\r\n' % len(body)
    connection.sendall(head + body)


def blanks(connection: socket.socket) -> None:
    """Blanks without end."""
    connection.sendall(_HEAD + b'Transfer-Encoding: chunked\r\n\r\n')
    while True:
        connection.sendall(b'10000\r\n' + b' ' * 65_536 + b'\r\n')


def lists(connection: socket.socket) -> None:
    """JSON that takes thirty times its bytes as lists of Python."""
    connection.sendall(_HEAD + b'Content-Length: 30000004\r\n\r\n[')
    for _ in range(1000):
        connection.sendall(b'[],' * 10_000)
    connection.sendall(b'[]]')


def slow_body(connection: socket.socket) -> None:
    """A blank each moment."""
    _slowly(connection, _HEAD + b'Transfer-Encoding: chunked\r\n\r\n', b'1\r\n \r\n')


def slow_head(connection: socket.socket) -> None:
    """A byte of a header each moment."""
    _slowly(connection, _HEAD + b'X-More: ', b'x')


def _slowly(connection: socket.socket, begin: bytes, more: bytes) -> None:
    connection.sendall(begin)
    while True:
        connection.sendall(more)
        time.sleep(0.05)


def many_heads(connection: socket.socket) -> None:
    """Headers without end."""
    connection.sendall(_HEAD)
    while True:
        connection.sendall(b'X-More: more\r\n' * 1000)


def redirects(connection: socket.socket) -> None:
    """Away, to itself."""
    connection.sendall(b'HTTP/1.1 302 Found\r\nLocation: /\r\nContent-Length: 0\r\n\r\n')


def packed_otherwise(connection: socket.socket) -> None:
    """As nobody has asked for."""
    connection.sendall(_HEAD + b'Content-Encoding: br\r\nContent-Length: 2\r\n\r\n\x3b\0')


def nothing(connection: socket.socket) -> None:
    """Not even a head, for as long as it is listened to."""
    connection.recv(1)


ONCE = {'max.retries': 0, 'timeout': 30}
SECRET = 'swordfish-31b0'  # noqa: S105 (of a test)


def encode_error(url: str, properties: dict[str, Any] | None = None, **schema: Any) -> BridgeError:
    with pytest.raises(BridgeError) as raised:
        make_encode(ROBOT, scope_of(url, 'robots', ONCE | (properties or {}), **schema))
    return raised.value


def decode_error(url: str, value: bytes, properties: dict[str, Any] | None = None) -> BridgeError:
    decode = make_decode(ROBOT, scope_of(url, 'robots', ONCE | (properties or {})))
    with pytest.raises(BridgeError) as raised:
        decode(value)
    return raised.value
