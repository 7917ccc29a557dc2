"""The web server of the process, on a socket that the supervisor has opened."""

import asyncio
import logging
import socket
from collections.abc import Callable
from typing import Any, Final

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from ros2_kafka_bridge.monitoring.guard import Names, names_of
from ros2_kafka_bridge.monitoring.replay import ReplayRunner
from ros2_kafka_bridge.monitoring.sides import Sides
from ros2_kafka_bridge.monitoring.state import Watch
from ros2_kafka_bridge.monitoring.web import Page, make_app

_GRACE_S: Final = 2
_PATIENCE_S: Final = 15
_BACKLOG: Final = 128


class Connection(H11Protocol):
    """A connection that has to ask for something, in a whole request, within some seconds.

    uvicorn waits for ever for the first one, and for the rest of one that has begun. Some hundred
    of such connections would shut everybody out, also the probes of Kubernetes, which would then
    end the bridge.
    """

    patience_s: float = _PATIENCE_S
    _last: Any = None
    _timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait."""
        super().connection_made(transport)
        self._timer = self.loop.call_later(self.patience_s, self._look)

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait no more."""
        super().connection_lost(exc)
        if self._timer is not None:
            self._timer.cancel()

    def _look(self) -> None:
        """Let go who has asked for nothing since the last look, and is not being answered."""
        answered = self.cycle is None or self.cycle.response_complete
        if answered and self.cycle is self._last:
            self.transport.close()
            return
        self._last = self.cycle
        self._timer = self.loop.call_later(self.patience_s, self._look)


class Server:
    """Serves until it is stopped; runs in a thread that is not the main one.

    Args:
        watch: Knows the bridge.
        listener: Bound, perhaps listening already.
        failed: Told when a thread beside it has met a bug.
    """

    def __init__(self, watch: Watch, listener: socket.socket, failed: Callable[[], None]) -> None:
        self._watch = watch
        self._listener = listener
        self._sides = Sides(watch, failed)
        self._replay = ReplayRunner(self._sides.look_again)
        page = Page(watch, self._sides, self._replay, self._names, self._stopping, failed)
        _log_as_the_bridge()
        self._server = uvicorn.Server(
            uvicorn.Config(
                make_app(page),
                http=Connection,
                lifespan='on',
                log_config=None,
                log_level='error',
                access_log=False,
                server_header=False,
                proxy_headers=False,
                ws='none',
                timeout_keep_alive=_PATIENCE_S,
                timeout_graceful_shutdown=_GRACE_S,
                limit_concurrency=500,
                h11_max_incomplete_event_size=32 * 1024,
            )
        )

    def run(self) -> None:
        """Serve until `stop`."""
        self._listener.listen(_BACKLOG)
        with self._sides:
            self._server.run(sockets=[self._listener])
            self._replay.close()

    def stop(self) -> None:
        """Finish what is being answered, then end."""
        self._server.should_exit = True

    def _stopping(self) -> bool:
        return self._server.should_exit

    def _names(self) -> Names:
        settings = self._watch.config.monitoring
        address = self._listener.getsockname()
        host, port = str(address[0]), int(address[1])
        given = settings.address if settings else None
        own = {host} | ({given.host} if given else set())
        more = settings.allowed_hosts if settings else ()
        found = [names_of(name, port, more) for name in own]
        return Names(frozenset().union(*(it.hosts for it in found)), found[0].added)


def _log_as_the_bridge() -> None:
    """Let uvicorn write its lines as the bridge does, also as JSON."""
    theirs = logging.getLogger('uvicorn')
    theirs.handlers = logging.getLogger('ros2_kafka_bridge').handlers
    theirs.propagate = False
