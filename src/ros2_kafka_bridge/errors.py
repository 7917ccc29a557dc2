"""The errors of the bridge, grouped by what is done about them.

BridgeError
├── ConfigError              nothing was started: mend the configuration (exit status 2)
├── RecordError              this record or message can never be delivered: on_error applies
│   ├── DecodeError          a record's value is not what the route's format says
│   ├── EncodeError          a message cannot be written in the route's format
│   ├── LoopError            a record came from the ROS topic that it would be published to
│   ├── RecordTooLargeError  larger than a limit of the route or of the broker
│   └── TimestampError       a record has no time by which it could be too old (max_age_s)
├── RouteError               this route alone has failed: tried again with backoff
│   └── SpoolInUseError      another process has its spool, and runs it where bridges take turns
└── TransportError           broker or subscriber away: wait and try again

A bug (AssertionError, TypeError, ...) is none of these and ends the process, with one exception:
where one record is decoded, or one message encoded, it is a RecordError that tells of it
(`error_of_bug`). The same record would end the process again after each start.

What code of others raises, a message package for one, is no bug of the bridge, whatever it is:
`blamed` says whose it is.

What an error says may quote an address of the configuration, and goes to the log, to the page,
into a dead letter: of its user and its query nothing is said (`masked_addresses`).
"""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final, NamedTuple

from ros2_kafka_bridge.outside.masking import masked_addresses

if TYPE_CHECKING:
    from pathlib import Path


REASON_CHARS: Final = 1000
"""Of why a record is refused: names in a schema of others may be as long as they like."""

_LONGEST: Final = 500
_OWN: Final = __file__.removesuffix('errors.py')


class About(NamedTuple):
    """Which record or message an error, or a line of the log, is about; None is left out.

    Args:
        topic: The Kafka topic that it was read from, or is on its way to.
        partition: Where the record lies in it.
        offset: The same.
        ros_topic: The ROS topic that a message came from.
        gid: Of its publisher, in hex.
        seq: Its number at its publisher.
        trace_id: Of the trace that it belongs to.
        error: Class of the error (`DecodeError`).
    """

    topic: str | None = None
    partition: int | None = None
    offset: int | None = None
    ros_topic: str | None = None
    gid: str | None = None
    seq: int | None = None
    trace_id: str | None = None
    error: str | None = None


class BridgeError(Exception):
    """The root of everything that the bridge raises on purpose.

    Args:
        message: What happened; addresses in it are masked.
    """

    def __init__(self, message: str = '') -> None:
        super().__init__(masked_addresses(message))


class ConfigError(BridgeError):
    """The configuration is wrong; `problems` holds every mistake found, one line each."""

    def __init__(self, problems: list[str]) -> None:
        self.problems = [masked_addresses(problem) for problem in problems]
        super().__init__('\n'.join(self.problems))


class RecordError(BridgeError):
    """One record or message can never be delivered.

    Args:
        message: Why.
        bug: What the bridge itself did wrong with it; None where it did nothing wrong.
    """

    def __init__(self, message: str, *, bug: Exception | None = None) -> None:
        super().__init__(message[:REASON_CHARS])
        self.bug = bug


class DecodeError(RecordError):
    """The value of a record is not what the format of the route says."""


class EncodeError(RecordError):
    """A message cannot be written in the format of the route."""


class LoopError(RecordError):
    """A record was made by this bridge of a message of the ROS topic that it would go to."""


class TimestampError(RecordError):
    """A record has no time by which it could be too old, and its route asks for its age."""


def error_of_bug(
    kind: type[DecodeError] | type[EncodeError], bug: Exception
) -> DecodeError | EncodeError:
    """Make the error of a record or message from what nobody expected to be raised for it."""
    part = 'decoder' if kind is DecodeError else 'encoder'
    told = ': '.join(filter(None, (type(bug).__name__, str(bug)[:_LONGEST])))
    text = (
        f"the bridge's own {part} failed: {told}: a bug of the bridge, report it with the "
        'traceback of its log'
    )
    return kind(text, bug=bug)


class RecordTooLargeError(RecordError):
    """A record or message is larger than a limit.

    Args:
        size_bytes: The size that was refused.
        limit_bytes: The limit, None where only the broker knows it.
        limit_name: Where the limit is set, in the words of the one who can change it.
    """

    def __init__(self, size_bytes: int, limit_bytes: int | None, limit_name: str) -> None:
        limit = limit_name if limit_bytes is None else f'{limit_name} ({limit_bytes} bytes)'
        super().__init__(f'{size_bytes} bytes, more than {limit}')
        self.size_bytes = size_bytes
        self.limit_bytes = limit_bytes


class RouteError(BridgeError):
    """One route cannot go on; the others do.

    Args:
        message: What happened, and what to do.
        final: True where trying again cannot help (`on_error: stop`).
        about: The record or message that it is for, if it is for one.
    """

    def __init__(self, message: str, *, final: bool = False, about: 'About | None' = None) -> None:
        super().__init__(message)
        self.final = final
        self.about = about


class SpoolInUseError(RouteError):
    """Another process of this machine has the spool of the route open.

    Args:
        process: Its number, 0 where that is not known.
        place: The file that it has locked.
    """

    def __init__(self, process: int, place: 'Path') -> None:
        super().__init__(
            f'another process uses this spool (pid {process or "unknown"}): {place}: '
            'stop it, or give one of the bridges another name or spool.path'
        )
        self.short = f'process {process or "unknown"} still has the spool {place}'


class TransportError(BridgeError):
    """The other side is away or busy for now."""


@contextmanager
def blamed(what: str) -> Iterator[None]:
    """Make a RouteError of whatever code of others raises, also where it is to end the process.

    Tried again, it may be mended by then: a package is built anew while the bridge runs.

    Args:
        what: What they fail at, and whose it is, before a colon.
    """
    try:
        yield
    except BridgeError:
        raise
    except BaseException as error:
        in_main = threading.current_thread() is threading.main_thread()
        if isinstance(error, KeyboardInterrupt) and in_main:
            raise  # it is the user's
        ours = _place(error).startswith(_OWN)
        hint = ': perhaps a bug of the bridge, report it' if ours else ''
        raise RouteError(f'{what}: {fault_of(error)}{hint}') from error


def fault_of(error: BaseException) -> str:
    """What code of others has raised, and where, on one line."""
    if isinstance(error, ImportError):
        return _words_of(error)  # they say what it is
    told = ': '.join(filter(None, (type(error).__name__, _words_of(error))))
    place = _place(error)
    return f'{told} ({place})' if place else told


def _words_of(error: BaseException) -> str:
    try:
        text = str(error.msg if isinstance(error, SyntaxError) else error)
    except BaseException:  # noqa: BLE001 (of a class of others)
        return ''
    return ' '.join(text.split())[:_LONGEST]


def _place(error: BaseException) -> str:
    """The file and line of whoever has raised it."""
    if type(error) in {SyntaxError, IndentationError, TabError}:
        return f'{error.filename}:{error.lineno}'  # type: ignore[attr-defined]
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return '' if trace is None else f'{trace.tb_frame.f_code.co_filename}:{trace.tb_lineno}'
