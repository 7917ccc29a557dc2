"""Which record or message a line of the log is about."""

import re
from typing import Final, NamedTuple, Self

from ros2_kafka_bridge.endpoints import HeaderList
from ros2_kafka_bridge.errors import BridgeError
from ros2_kafka_bridge.tracing.context import trace_id_of

_GID: Final = re.compile(r'[0-9a-f]{2,64}')
_NUMBER: Final = re.compile(r'\d{1,19}', re.ASCII)


class About(NamedTuple):
    """Fields of a line that is about one record or message; None is left out.

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

    @classmethod
    def labelled(cls, headers: HeaderList | None, error: BridgeError | None = None) -> Self:
        """What the headers of a record tell, which anyone may have written, and an error."""
        told = dict(headers or [])
        gid, seq = _text(told.get('ros.gid')), _text(told.get('ros.seq'))
        return cls(
            gid=gid if _GID.fullmatch(gid) else None,
            seq=int(seq) if _NUMBER.fullmatch(seq) else None,
            trace_id=trace_id_of(headers),
            error=None if error is None else type(error).__name__,
        )


def _text(value: str | bytes | None) -> str:
    return value if isinstance(value, str) else (value or b'').decode(errors='replace')
