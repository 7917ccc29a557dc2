"""A participant of DDS that is no program of ROS, and tells of itself what nobody else would.

RTPS 2.3, one way: it announces itself and one publisher again and again, to the ports that the
first participants of a domain listen on, and hears nothing.
"""

import os
import socket
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

_VENDOR: Final = b'\x01\x0f'
_PARTICIPANT: Final = bytes.fromhex('000001c1')
_WRITER: Final = bytes.fromhex('00000103')
_SPDP: Final = bytes.fromhex('000100c7'), bytes.fromhex('000100c2')  # reader, writer
_SEDP: Final = bytes.fromhex('000003c7'), bytes.fromhex('000003c2')
_PL_CDR: Final = b'\0\3\0\0'
_PARTICIPANTS: Final = 12
_LEASE_S: Final = 4


def negative_lifespan() -> bytes:
    """A QoS whose duration is below zero."""
    return parameter(0x2B, struct.pack('<iI', -(2**31), 2**32 - 1))


@contextmanager
def stranger(
    domain: int,
    topic: bytes,
    type_name: bytes = b'std_msgs::msg::dds_::String_',
    qos: bytes = b'',
) -> Iterator[None]:
    """Announce a reliable, volatile publisher of a topic.

    Args:
        domain: The ROS domain.
        topic: As DDS has it, such as `rt/orders`.
        type_name: As DDS has it.
        qos: Further parameters of its publisher.
    """
    closed = threading.Event()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(('127.0.0.1', 0))
        announcing = _Announcing(one, domain, topic, type_name, qos)
        thread = threading.Thread(target=announcing.run, args=(closed,), daemon=True)
        thread.start()
        try:
            yield
        finally:
            closed.set()
            thread.join()


class _Announcing:
    """What is said again and again."""

    def __init__(
        self, one: socket.socket, domain: int, topic: bytes, type_name: bytes, qos: bytes
    ) -> None:
        self._prefix = _VENDOR + os.urandom(10)
        self._ports = [7400 + 250 * domain + 10 + 2 * number for number in range(_PARTICIPANTS)]
        self._socket = one
        self._domain = domain
        self._topic = topic
        self._type_name = type_name
        self._qos = qos

    def run(self, closed: threading.Event) -> None:
        count = 0
        while not closed.wait(0.2):
            count += 1
            self._send(_data(*_SPDP, self._of_participant()))
            self._send(_data(*_SEDP, self._of_publisher()) + _heartbeat(*_SEDP, count))

    def _send(self, submessages: bytes) -> None:
        now_s = time.time()
        seconds = struct.pack('<BBHII', 9, 1, 8, int(now_s), int(now_s % 1 * 2**32))
        message = b'RTPS\2\3' + _VENDOR + self._prefix + seconds + submessages
        for port in self._ports:
            self._socket.sendto(message, ('127.0.0.1', port))

    def _of_participant(self) -> bytes:
        here = struct.pack('<iI', 1, self._socket.getsockname()[1]) + bytes(12) + b'\x7f\0\0\1'
        return _PL_CDR + b''.join(
            [
                parameter(0x15, b'\2\3\0\0'),
                parameter(0x16, _VENDOR + b'\0\0'),
                parameter(0x50, self._prefix + _PARTICIPANT),
                parameter(0x58, struct.pack('<I', 0x0C3F)),
                parameter(0x31, here),
                parameter(0x32, here),
                parameter(0x02, struct.pack('<iI', _LEASE_S, 0)),
                parameter(0x0F, struct.pack('<I', self._domain)),
                parameter(0x2C, _counted(b'enclave=/;')),
                parameter(1, b''),
            ]
        )

    def _of_publisher(self) -> bytes:
        return _PL_CDR + b''.join(
            [
                parameter(0x5A, self._prefix + _WRITER),
                parameter(0x50, self._prefix + _PARTICIPANT),
                parameter(0x05, _counted(self._topic + b'\0')),
                parameter(0x07, _counted(self._type_name + b'\0')),
                parameter(0x1A, struct.pack('<IiI', 2, 0, 0)),
                parameter(0x1D, struct.pack('<I', 0)),
                self._qos,
                parameter(1, b''),
            ]
        )


def parameter(number: int, value: bytes) -> bytes:
    """One entry of what is announced."""
    padded = value + bytes(-len(value) % 4)
    return struct.pack('<HH', number, len(padded)) + padded


def _counted(value: bytes) -> bytes:
    return struct.pack('<I', len(value)) + value


def _data(reader: bytes, writer: bytes, payload: bytes) -> bytes:
    body = struct.pack('<HH', 0, 16) + reader + writer + struct.pack('<iI', 0, 1) + payload
    return struct.pack('<BBH', 0x15, 5, len(body)) + body


def _heartbeat(reader: bytes, writer: bytes, count: int) -> bytes:
    body = reader + writer + struct.pack('<iIiII', 0, 1, 0, 1, count)
    return struct.pack('<BBH', 7, 3, len(body)) + body
