"""What a supervisor tells its workers to do, and what they tell beside their snapshots.

One line of JSON for each. Orders come by standard input; what has happened goes through the pipe
of the snapshots.
"""

from typing import Final

import msgspec


class Drain(msgspec.Struct, frozen=True, tag='drain'):
    """Stop: a drain; asked for a second time, an end at once."""


class Begin(msgspec.Struct, frozen=True, tag='begin'):
    """Run the routes, for a worker that has loaded everything and waits."""


class End(msgspec.Struct, frozen=True, tag='end'):
    """Drain these routes and forget them."""

    routes: tuple[str, ...]


class PauseRoute(msgspec.Struct, frozen=True, tag='pause'):
    """Take and publish nothing on a route."""

    route: str


class ResumeRoute(msgspec.Struct, frozen=True, tag='resume'):
    """Let a paused route go on."""

    route: str


class RouteFailed(msgspec.Struct, frozen=True, tag='failed'):
    """A route has failed for good: the snapshots say so."""


class Loaded(msgspec.Struct, frozen=True, tag='loaded'):
    """Everything is loaded and joined: the routes could begin."""


class Begun(msgspec.Struct, frozen=True, tag='begun'):
    """Every route has begun."""


class RoutesEnded(msgspec.Struct, frozen=True, tag='ended'):
    """These routes were drained, and are forgotten."""

    routes: tuple[str, ...]


WorkerOrder = Drain | Begin | End | PauseRoute | ResumeRoute
Event = RouteFailed | Loaded | Begun | RoutesEnded

ORDERS: Final = msgspec.json.Decoder(WorkerOrder)
EVENTS: Final = msgspec.json.Decoder(Event)


def to_line(said: WorkerOrder | Event) -> bytes:
    """Write it as a line of JSON."""
    return msgspec.json.encode(said) + b'\n'
