"""Who is at the topics of the routes, looked at once for a whole process.

One thread waits until the ROS graph says that something in it has changed, looks at each topic
that a route watches, and tells those routes whose topic shows another picture than before.
"""

import contextlib
import logging
import threading
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from typing import Final, Protocol

from ros2_kafka_bridge.ros.peer import Peer

# What changes comes in bursts: a node that joins changes the graph a dozen times.
_REST_S: Final = 0.02
_MOST_WORK: Final = 0.1  # of the time, where many topics are watched and much changes
# Nothing is known to go unseen. A look now and then costs less than to be wrong about it.
_AGAIN_S: Final = 30.0
_TURN_S: Final = 5.0  # what could not be told is asked for again after so long
_UNTOLD_S: Final = 0.1  # where rcl does not tell of changes
_END_S: Final = 2.0

AskPeers = Callable[[], Sequence[Peer]]


class Changes(Protocol):
    """Waits until something changes in the ROS graph (`ros.rcl.GraphChanges`)."""

    def wait(self, timeout_s: float) -> bool:
        """Wait until something has changed since the last call, or this is to end.

        Returns:
            Whether something has changed.
        """

    def end(self) -> None:
        """End the wait, this one or the next."""


class View:
    """Who publishes on a topic, or subscribes to it, as the graph has told last.

    Args:
        ask: Asks the graph.
        tell: Called where another thread has seen a change.
    """

    def __init__(self, ask: AskPeers, tell: Callable[[], None]) -> None:
        self._version = self._read = 0  # of the picture, and of that which was read last
        self._ask = ask
        self.tell = tell
        self._lock = threading.Lock()  # an older answer never takes the place of a newer one
        self._told: dict[bytes, Peer] | Exception = {}

    @property
    def peers(self) -> Collection[Peer]:
        """Those who are there.

        Raises:
            BridgeError: The graph could not be asked.
        """
        told = self._told  # another thread may replace it
        if isinstance(told, Exception):
            raise told.with_traceback(None)
        return told.values()

    @property
    def has_failed(self) -> bool:
        """Whether the graph could not be asked the last time."""
        return isinstance(self._told, Exception)

    @property
    def has_news(self) -> bool:
        """Whether the picture has changed since it was read."""
        return self._version != self._read

    def read(self) -> Collection[Peer]:
        """Take the picture as it is for read.

        Raises:
            BridgeError: The graph could not be asked.
        """
        self._read = self._version
        return self.peers

    def look(self) -> bool:
        """Ask now; tells whether anybody has appeared, gone or changed."""
        with self._lock:
            before = self._told
            try:
                self._told = {peer.gid: peer for peer in self._ask()}
            except Exception as error:  # noqa: BLE001 (raised for those who use it)
                self._told = error
            is_news = isinstance(self._told, Exception) or self._told != before
            self._version += is_news
            return is_news


class Graph:
    """Looks for all routes of a process; any thread may call.

    Args:
        make_changes: Makes what waits for changes; None where nothing tells of them.
    """

    def __init__(self, make_changes: Callable[[], Changes | None]) -> None:
        self._make_changes = make_changes
        self._changes: Changes | None = None
        self._views: frozenset[View] = frozenset()
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._ended = threading.Event()

    def watch(self, ask: AskPeers, tell: Callable[[], None]) -> View:
        """Look at something now, and again whenever the graph has changed.

        Args:
            ask: Asks the graph.
            tell: Called in another thread where the picture is another one.
        """
        view = View(ask, tell)
        with self._lock:
            self._views |= {view}
            if self._thread is None:
                self._changes = self._made_changes()
                self._thread = threading.Thread(target=self._keep_looking, name='ROS graph')
                self._thread.daemon = True
                self._thread.start()
        view.look()
        return view

    def forget(self, view: View) -> None:
        """Look at it no more."""
        with self._lock:
            self._views -= {view}

    @contextmanager
    def watched(self, ask: AskPeers) -> Iterator[View]:
        """Watch something as long as `with` lasts, for who looks at the view by itself."""
        view = self.watch(ask, lambda: None)
        try:
            yield view
        finally:
            self.forget(view)

    def close(self) -> None:
        """Look at nothing any more."""
        self._ended.set()
        if self._changes is not None:
            with contextlib.suppress(Exception):  # of no use any more: the wait ends by itself
                self._changes.end()
        if self._thread is not None:
            self._thread.join(_END_S)

    def look(self) -> None:
        """Look at all that is watched, and tell who sees another picture."""
        for view in self._views:
            if view.look():
                view.tell()

    def _made_changes(self) -> Changes | None:
        try:
            return self._make_changes()
        except Exception as error:  # noqa: BLE001 (the graph is asked again and again)
            self._say_untold(error)
            return None

    def _keep_looking(self) -> None:
        look_at_s = 0.0
        while not self._ended.is_set():
            has_changed = self._wait()
            began_s = time.monotonic()
            has_failed = any(view.has_failed for view in self._views)
            if not (has_changed or has_failed or began_s >= look_at_s):
                continue
            self.look()
            ended_s = time.monotonic()
            look_at_s = ended_s + _AGAIN_S
            took_s = ended_s - began_s
            self._ended.wait(max(_REST_S, took_s / _MOST_WORK - took_s))

    def _wait(self) -> bool:
        """Wait for a change, for a moment; tells whether there may be one."""
        if self._changes is None:
            self._ended.wait(_UNTOLD_S)
            return True
        try:
            return self._changes.wait(_TURN_S)
        except Exception as error:  # noqa: BLE001 (routes go on: it is asked again and again)
            self._changes = None
            self._say_untold(error)
            return True

    def _say_untold(self, error: Exception) -> None:
        log, every_s = logging.getLogger(__name__), _UNTOLD_S
        log.warning('ROS tells of no changes of its graph (%s): asks each %s s', error, every_s)
