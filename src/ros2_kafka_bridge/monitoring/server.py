"""The web server of the process, on a socket that the supervisor has opened."""

import asyncio
import logging
import resource
import socket
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any, Final

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from ros2_kafka_bridge.logs.lines import route_log, summed
from ros2_kafka_bridge.logs.summed import Summed
from ros2_kafka_bridge.monitoring.replay import ReplayRunner
from ros2_kafka_bridge.monitoring.sides import Sides
from ros2_kafka_bridge.monitoring.state import Watch
from ros2_kafka_bridge.monitoring.web import Page, make_app
from ros2_kafka_bridge.web.caller import has_shown_token, network_of, who
from ros2_kafka_bridge.web.guard import Names, names_of

_GRACE_S: Final = 2
_PATIENCE_S: Final = 15
_STALLED_S: Final = 30
_NEW_S: Final = 1.0
_BACKLOG: Final = 128  # so many are taken in at once, before the first of them makes room
_MOST_CONNECTIONS: Final = 500
_OTHERS_S: Final = 60.0  # how often is said what anybody can have said in the log


class Connection(H11Protocol):
    """A connection that has to ask for something, in a whole request, within some seconds.

    uvicorn waits for ever for the first one, for the rest of one that has begun, and until its
    answer is taken. Where there are too many it refuses what comes last, also the probes of
    Kubernetes, which would then end the bridge: so here one makes room of the client that has
    most, and of its own who has been idle for longest.

    Args:
        said: The log, which is told when there are too many.
        most: How many there may be at once.
        given: What uvicorn gives each connection.
    """

    patience_s: float = _PATIENCE_S
    stalled_s: float = _STALLED_S
    new_s: float = _NEW_S
    idle_since_s: float = 0.0
    network: str = ''
    _last: Any = None
    _was_closing: bool = False
    _timer: asyncio.TimerHandle | None = None
    _stalled: asyncio.TimerHandle | None = None

    def __init__(self, said: Summed, most: int, **given: Any) -> None:
        super().__init__(**given)
        self._said = said
        self._most = most

    @property
    def is_answered(self) -> bool:
        """Whether it has asked for something that it has not got yet."""
        return self.cycle is not None and not self.cycle.response_complete

    @property
    def is_busy(self) -> bool:
        """Whether it is answered, or has come so lately that what it asks for was not read yet."""
        return self.is_answered or self.loop.time() - self.idle_since_s < self.new_s

    @property
    def has_token(self) -> bool:
        """Whether what it asks for has come with the token."""
        return self.cycle is not None and has_shown_token(self.cycle.scope)

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait, in the place of another if need be."""
        super().connection_made(transport)
        self.idle_since_s = self.loop.time()
        self.network = network_of(self.client)
        self._timer = self.loop.call_later(self.patience_s, self._look)
        if len(self.connections) > self._most:
            self._make_room()

    def on_response_complete(self) -> None:
        """Begin to wait for what it asks for next."""
        self.idle_since_s = self.loop.time()
        super().on_response_complete()

    def pause_writing(self) -> None:
        """Wait until more of the answer is taken, but not for ever."""
        super().pause_writing()
        self._stalled = self.loop.call_later(self.stalled_s, self.transport.abort)

    def resume_writing(self) -> None:
        """Go on: it has been taken."""
        super().resume_writing()
        if self._stalled is not None:
            self._stalled.cancel()

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait no more."""
        super().connection_lost(exc)
        for timer in (self._timer, self._stalled):
            if timer is not None:
                timer.cancel()

    def _look(self) -> None:
        """Let go who has asked for nothing since the last look, and is not being answered."""
        if self._was_closing:
            self.transport.abort()  # it does not take the rest of its last answer
            return
        if not self.is_answered and self.cycle is self._last:
            self.transport.close()
        self._was_closing = self.transport.is_closing()
        self._last = self.cycle
        self._timer = self.loop.call_later(self.patience_s, self._look)

    def _make_room(self) -> None:
        """Let go one of the client that has most: who is idle, or answered, for longest."""
        others = [it for it in self.connections if isinstance(it, Connection) and it is not self]
        of_each = Counter(it.network for it in others)
        oldest = min(
            others,
            key=lambda it: (it.has_token, -of_each[it.network], it.is_busy, it.idle_since_s),
        )
        # That it is lost comes with the next turn of the loop, others may come before.
        self.connections.discard(oldest)
        oldest.transport.abort()  # not close: one that takes nothing would stay
        text = f'the page: {self._most} connections at once'
        done = 'one of the client that has most is let go'
        newest = f'; the newest is from {who(self.client)}'
        self._said.warning(f'{text}: {done}', newest, kind='connections')


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
        log = route_log()
        said = summed(log, first=1, period_s=_OTHERS_S)
        page = Page(
            watch, self._sides, self._replay, self._names, self._stopping, failed, log, said
        )
        _log_as_the_bridge()
        # It is called as a class would be, which is all that uvicorn does with it.
        connection: Any = partial(Connection, said, _most_connections())
        self._server = uvicorn.Server(
            uvicorn.Config(
                make_app(page),
                http=connection,
                lifespan='on',
                log_config=None,
                log_level='error',
                access_log=False,
                server_header=False,
                proxy_headers=False,
                ws='none',
                backlog=_BACKLOG,
                timeout_keep_alive=_PATIENCE_S,
                timeout_graceful_shutdown=_GRACE_S,
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


def _most_connections() -> int:
    """As many as leave half of the open files to all else: without one, no probe gets in."""
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    files = 2 * _MOST_CONNECTIONS if soft == resource.RLIM_INFINITY else soft
    return min(_MOST_CONNECTIONS, files // 2)


def _log_as_the_bridge() -> None:
    """Let uvicorn write its lines as the bridge does, also as JSON."""
    theirs = logging.getLogger('uvicorn')
    theirs.handlers = logging.getLogger('ros2_kafka_bridge').handlers
    theirs.propagate = False
