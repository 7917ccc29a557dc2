"""What the supervisor and the process that watches the bridge say to each other.

One value for each line, as JSON. The supervisor writes a `Report` each second, and an `Answer` to
each `Request`; the other side asks. A configuration holds secrets: it goes through the same pipe,
which nobody else can read.
"""

from enum import StrEnum
from typing import Any

import msgspec

from ros2_kafka_bridge.route.counters import Snapshot


class Lifecycle(StrEnum):
    """What the bridge as a whole does, in the words of a managed ROS node."""

    UNCONFIGURED = 'unconfigured'
    INACTIVE = 'inactive'
    ACTIVE = 'active'
    FINALIZED = 'finalized'


class Do(StrEnum):
    """What the supervisor can be asked for."""

    PAUSE = 'pause'
    RESUME = 'resume'
    PREVIEW = 'preview'  # tell what a reload would change
    RELOAD = 'reload'
    CONFIGURE = 'configure'
    ACTIVATE = 'activate'
    DEACTIVATE = 'deactivate'
    CLEANUP = 'cleanup'
    SHUTDOWN = 'shutdown'


class Request(msgspec.Struct, frozen=True, tag='request'):
    """Something to be done.

    Args:
        number: Told again by its answer.
        do: What.
        route: Which route is paused or resumed.
    """

    number: int
    do: Do
    route: str = ''


class Answer(msgspec.Struct, frozen=True, tag='answer'):
    """What came of a request: at once for a pause, after the drain for a deactivation.

    Args:
        number: That of the request.
        done: Whether it was done, or, for a preview, would be.
        text: What was done, or why not and what to do; may have several lines.
        changes: For a preview and a reload: what differs, a line each.
        said: Whether the supervisor has said it in the log.
    """

    number: int
    done: bool
    text: str
    changes: tuple[str, ...] = ()
    said: bool = False


class Configured(msgspec.Struct, frozen=True, tag='configured'):
    """The configuration that counts from now on: at the start, and after a reload.

    Args:
        values: Its settings, as `config.settings.restored` takes them. They hold secrets.
        file: Its name, for messages.
        routes: The names of those that this bridge runs; empty means all.
    """

    values: dict[str, Any]
    file: str
    routes: tuple[str, ...] = ()


class Worker(msgspec.Struct, frozen=True):
    """A process that runs routes.

    Args:
        number: From 1.
        pid: 0 while it does not run.
        starts: How often it was started.
        problem: Why it does not run; empty where it does.
        silent_s: For how long it has told nothing of its routes, though it should each second.
    """

    number: int
    pid: int
    starts: int
    problem: str = ''
    silent_s: float = 0.0


class RouteReport(msgspec.Struct, frozen=True):
    """A route as its worker told it last.

    Args:
        worker: Number of its worker, 0 where it has none, as in a bridge that is not active.
        age_s: How long ago the snapshot was made by the route's own thread, None where it has
            told nothing. A route that fails or stands by makes none meanwhile.
        busy_s: For how long its thread has done one thing without coming back to its loop, 0 for
            one that waits on purpose (backoff, standing by, paused).
        snapshot: Its counters and measures, all of one moment.
    """

    worker: int
    age_s: float | None
    busy_s: float
    snapshot: Snapshot


class Reload(msgspec.Struct, frozen=True):
    """How the last reload ended.

    Args:
        time_s: When, since 1970.
        done: Whether the new file counts.
        text: What was done, or each mistake of the file.
    """

    time_s: float
    done: bool
    text: str


class Report(msgspec.Struct, frozen=True, tag='report'):
    """How the bridge is doing at one moment.

    Args:
        time_s: Since 1970.
        lifecycle: Of the whole bridge.
        stopping: Whether it drains to end.
        started_s: When the supervisor was started, since 1970.
        workers: All processes.
        routes: All routes, in the order of the file.
        paused: Names of the routes that were asked to pause.
        reload: The last one, if there was one.
    """

    time_s: float
    lifecycle: Lifecycle
    stopping: bool
    started_s: float
    workers: tuple[Worker, ...]
    routes: tuple[RouteReport, ...]
    paused: tuple[str, ...] = ()
    reload: Reload | None = None


ToMonitor = Report | Answer | Configured
"""What the supervisor writes."""
