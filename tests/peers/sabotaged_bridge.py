"""A bridge in which each call of the two foreign libraries fails once, one call after the other.

    python sabotaged_bridge.py FILE SECONDS refused|fatal [ROUTE CALL]

A call is met in the thread of its route: `Consumer.poll`, `EventHandle.take_event`. Each that
was met raises what its library would raise; then the route has to flow again within SECONDS,
and the other routes never fail. A line is printed for each, with how the route fared, and then
one for each call that is `at start` only. With a CALL that one alone fails, while the bridge
begins. `done` comes last; the bridge runs on until SIGTERM.
"""

import functools
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import confluent_kafka
from confluent_kafka import KafkaError, KafkaException
from confluent_kafka.admin import AdminClient
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

from ros2_kafka_bridge.ros import rcl

Call = tuple[str, str]
"""Route and name of a call."""

_KAFKA = ('Consumer.', 'Producer.', 'AdminClient.')
_ROS_CLASSES = ('Publisher', 'Subscription', 'WaitSet', 'EventHandle')
_ROS_BASE_CALLS = ('__enter__', 'destroy_when_not_in_use')
_LOOK_S = 0.01
_MEET_S = 2.0  # a graph is looked at each second, a lag counted as often
_PROVOKED_BY = {
    'to_ros': 'Consumer.poll',
    'to_kafka': 'Producer.poll',
}
_OLD_CLIENT = 'unattended: old client of '


class Saboteur:
    """Knows which calls are made, and lets some of them fail once."""

    def __init__(self, kafka_error: KafkaError) -> None:
        self.met: dict[Call, None] = {}  # in their order
        self.armed: set[Call] = set()
        self._kafka_error = kafka_error

    def calls(self, name: str) -> None:
        """Fail, if it is the turn of this call in this thread."""
        route = _route_of(threading.current_thread().name)
        if route not in _PROVOKED_BY:
            return
        call = (route, name)
        self.met.setdefault(call)
        if call in self.armed:
            self.armed.discard(call)
            raise self._error(name)

    def _error(self, name: str) -> Exception:
        if name.startswith(_KAFKA):
            return KafkaException(self._kafka_error)
        return _rclpy.RCLError(f'sabotaged {name}, at ./somewhere.c:1')

    def wrap(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The same function, which may fail."""

        @functools.wraps(function)
        def wrapped(*arguments: Any, **more: Any) -> Any:
            self.calls(name)
            return function(*arguments, **more)

        return wrapped


def _route_of(thread: str) -> str:
    """The route that a thread works for; the name of the thread where it is none's."""
    if thread.startswith(_OLD_CLIENT):
        return 'to_kafka' if thread.endswith('.lock') else 'to_ros'
    return 'to_ros' if thread == 'unattended: commit' else thread


def sabotage_kafka(saboteur: Saboteur) -> None:
    """Replace the clients, before anything imports them."""
    for name in ('Consumer', 'Producer'):
        setattr(confluent_kafka, name, _sabotaged(saboteur, getattr(confluent_kafka, name)))
    for method in ('__init__', *(name for name in dir(AdminClient) if not name.startswith('_'))):
        name = f'AdminClient.{method}'
        setattr(AdminClient, method, saboteur.wrap(name, getattr(AdminClient, method)))


def _sabotaged(saboteur: Saboteur, kind: type[Any]) -> type[Any]:
    """A client like the one of C, whose methods nobody can replace."""
    name = kind.__name__

    class Sabotaged(kind):  # type: ignore[misc]  # which of the two is known at run time
        def __init__(self, *arguments: Any, **more: Any) -> None:
            saboteur.calls(f'{name}.__init__')
            super().__init__(*arguments, **more)

        def __getattribute__(self, attribute: str) -> Any:
            found = super().__getattribute__(attribute)
            if attribute.startswith('_') or not callable(found):
                return found
            return saboteur.wrap(f'{name}.{attribute}', found)

    return Sabotaged


def sabotage_ros(saboteur: Saboteur) -> None:
    """Replace what rclpy's Python calls of its C side."""
    for name in _ROS_CLASSES:
        kind = getattr(_rclpy, name)
        for method, function in vars(kind).copy().items():
            if callable(function) and not method.startswith('_'):
                setattr(kind, method, saboteur.wrap(f'{name}.{method}', function))
        kind.__init__ = saboteur.wrap(f'{name}.__init__', kind.__init__)
    for method in _ROS_BASE_CALLS:
        function = getattr(_rclpy.Destroyable, method)
        setattr(_rclpy.Destroyable, method, saboteur.wrap(f'Destroyable.{method}', function))
    for name, function in vars(_rclpy).copy().items():
        if name.startswith('rclpy_') and callable(function):
            setattr(_rclpy, name, saboteur.wrap(name, function))
    make_take = rcl.make_take

    def make(subscription: Any, otherwise: rcl.Take, most_bytes: int = sys.maxsize) -> rcl.Take:
        return saboteur.wrap('rcl.take', make_take(subscription, otherwise, most_bytes))

    rcl.make_take = make


class Trial:
    """Lets calls of a running bridge fail, and watches how its routes fare.

    Args:
        saboteur: Who lets them fail.
        bridge: It has begun.
        within_s: How long a route has to flow again.
    """

    def __init__(self, saboteur: Saboteur, bridge: Any, within_s: float) -> None:
        self._saboteur = saboteur
        self._bridge = bridge
        self._within_s = within_s
        self._routes = [each.route for each in bridge.snapshots()]

    def of_all(self) -> None:
        """Go on until every call that comes again has failed once."""
        first = self._let_be_met()
        self._saboteur.met.clear()
        again = self._let_be_met()
        tried: set[Call] = set()
        hit: set[Call] = set()
        # One that fails can make others be met, those of a new client for instance.
        while left := [call for call in (*again, *self._saboteur.met) if call not in tried]:
            tried.add(left[0])
            if self._try(*left[0]):
                hit.add(left[0])
        for route, name in dict.fromkeys((*first, *self._saboteur.met)):
            if (route, name) not in hit:
                say(f'at start: {route} {name}')

    def _let_be_met(self) -> list[Call]:
        """Wait until routes have flowed, failed and flowed again; returns the calls of that."""
        for route in self._routes:
            self._flows(route)
            self._saboteur.armed.add((route, _PROVOKED_BY[route]))
        time.sleep(_MEET_S)
        for route in self._routes:
            self._flows(route)
        return list(self._saboteur.met)

    def _try(self, route: str, name: str) -> bool:
        """Let a call of a running bridge fail; tells whether it was made."""
        call, provoked = (route, name), (route, _PROVOKED_BY[route])
        armed = self._saboteur.armed
        armed.add(call)
        if not wait(_MEET_S, lambda: call not in armed):
            armed.add(provoked)
            wait(_MEET_S, lambda: call not in armed)
            armed.discard(provoked)
        is_hit = call not in armed
        armed.discard(call)
        if is_hit:
            self.fare(route, name)
        return is_hit

    def fare(self, route: str, name: str) -> None:
        """Say how a route fares one of whose calls has failed."""
        began_s = time.monotonic()
        others = self._flows(route)
        took_s = time.monotonic() - began_s
        fared = 'STANDS STILL' if others is None else f'flows after {took_s:.1f} s'
        failed = f', FAILED TOO: {", ".join(others)}' if others else ''
        say(f'{route}: {name}: {fared}{failed}')

    def _flows(self, route: str) -> list[str] | None:
        """Wait until a route confirms; returns which others have failed, None if it does not."""
        failed: set[str] = set()
        before = self._of(route).confirmed

        def flows() -> bool:
            states = {each.route: each.state for each in self._bridge.snapshots()}
            failed.update(one for one in states if one != route and states[one] == 'failed')
            confirmed: int = self._of(route).confirmed
            return confirmed > before and bool(states[route] == 'running')

        return sorted(failed) if wait(self._within_s, flows) else None

    def _of(self, route: str) -> Any:
        return next(each for each in self._bridge.snapshots() if each.route == route)


def wait(within_s: float, condition: Callable[[], bool]) -> bool:
    """Tells whether something has come in time."""
    deadline_s = time.monotonic() + within_s
    while not condition():
        if time.monotonic() > deadline_s:
            return False
        time.sleep(_LOOK_S)
    return True


def say(line: str) -> None:
    """Print at once."""
    os.write(1, f'{line}\n'.encode())


def main() -> int:
    """Run the bridge until SIGTERM; returns the exit status."""
    file, within_s, kind, *call = sys.argv[1:]
    is_fatal = kind == 'fatal'
    code = KafkaError._FATAL if is_fatal else KafkaError._SSL
    saboteur = Saboteur(KafkaError(code, 'sabotaged', fatal=is_fatal))
    sabotage_kafka(saboteur)
    sabotage_ros(saboteur)

    from ros2_kafka_bridge.bridge import Bridge  # noqa: PLC0415
    from ros2_kafka_bridge.logs import lines as logs  # noqa: PLC0415 (the libraries are replaced)
    from ros2_kafka_bridge.process.load import load_checked  # noqa: PLC0415
    from ros2_kafka_bridge.threads import backoff  # noqa: PLC0415 (the libraries are replaced)

    # A hundred failures in a few minutes: each is the first one.
    vars(backoff).update(_WELL_S=-1.0, _FIRST_S=0.2)
    logs.set_up('text')
    bridge = Bridge(load_checked(Path(file)))
    signal.signal(signal.SIGTERM, bridge.stop.on_signal)
    saboteur.armed.update(zip(call[::2], call[1::2], strict=True))
    trial = Trial(saboteur, bridge, float(within_s))

    def watch() -> None:
        if call:
            wait(float(within_s), lambda: not saboteur.armed)
            trial.fare(*call)
            say(''.join(f'NOT MET: {name}' for _, name in saboteur.armed))
        else:
            trial.of_all()
        say('done')

    threading.Thread(target=watch, daemon=True).start()
    return bridge.run()


sys.exit(main())
