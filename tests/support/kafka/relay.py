"""A way to a broker that forgets connections without a word, as a firewall does."""

import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Thread
from typing import Self

from ros2_kafka_bridge.testing.local_kafka import HOST, LocalKafka, free_port

_CHUNK_BYTES = 65_536

Begin = Callable[[socket.socket, socket.socket], None]


class Relay:
    """Passes bytes on between clients and a server; `with` opens and ends it.

    Args:
        to_port: Where the server listens, on this machine.
        begin: Gets the two ends of each connection, where somebody else is to pass on.
    """

    def __init__(self, to_port: int, begin: Begin | None = None) -> None:
        self._to_port = to_port
        self._begin = begin or self._pass_on
        self._server = socket.create_server((HOST, 0))
        self._ways: list[_Way] = []

    @property
    def port(self) -> int:
        """Where clients connect."""
        return int(self._server.getsockname()[1])

    @property
    def address(self) -> str:
        """The same, with the host."""
        return f'{HOST}:{self.port}'

    def __enter__(self) -> Self:
        Thread(target=self._accept, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown(socket.SHUT_RDWR)
        self._server.close()
        self._end_all()

    def forget(self) -> None:
        """Swallow from now on what comes through the connections that there are."""
        for way in self._ways:
            way.is_forgotten = True

    def _end_all(self) -> None:
        for way in self._ways:
            way.close()

    def _accept(self) -> None:
        with suppress(OSError):  # it is closed
            while True:
                self._let_through(self._server.accept()[0])

    def _let_through(self, client: socket.socket) -> None:
        try:
            server = socket.create_connection((HOST, self._to_port))
        except OSError:  # the server is not up
            client.close()
            return
        self._begin(client, server)

    def _pass_on(self, client: socket.socket, server: socket.socket) -> None:
        self._ways.append(_Way(client, server))


class _Way:
    """One connection through the relay."""

    def __init__(self, client: socket.socket, server: socket.socket) -> None:
        self.is_forgotten = False
        self._sockets = client, server
        for ends in ((client, server), (server, client)):
            Thread(target=self._pass_on, args=ends, daemon=True).start()

    def close(self) -> None:
        for one in self._sockets:
            with suppress(OSError):  # the other side was first
                one.shutdown(socket.SHUT_RDWR)
            one.close()

    def _pass_on(self, source: socket.socket, to: socket.socket) -> None:
        with suppress(OSError):  # one of the two is gone
            while data := source.recv(_CHUNK_BYTES):
                if not self.is_forgotten:
                    to.sendall(data)
        if not self.is_forgotten:
            self.close()


@contextmanager
def node_behind_relay(place: Path) -> Iterator[tuple[LocalKafka, Relay]]:
    """A node, and another way to it; who comes that way is told to come so again.

    Args:
        place: For what the node keeps.
    """
    behind = free_port()
    with Relay(behind) as relay, node_behind(place, behind, relay.port) as node:
        yield node, relay


@contextmanager
def node_behind(place: Path, behind: int, way: int) -> Iterator[LocalKafka]:
    """A node, and another way to it, by a port of somebody who passes all on to it.

    Args:
        place: For what the node keeps.
        behind: Where it is to be told what came that way.
        way: The port.
    """
    listeners = {'PLAINTEXT': free_port(), 'RELAY': way}
    properties = {
        'listeners': f'RELAY://{HOST}:{behind}',
        'advertised.listeners': ','.join(f'{n}://{HOST}:{p}' for n, p in listeners.items()),
        'listener.security.protocol.map': ','.join(
            f'{name}:PLAINTEXT' for name in ('CONTROLLER', *listeners)
        ),
    }
    with LocalKafka(place, listeners['PLAINTEXT'], properties) as node:
        yield node
