"""The headers of a record, which anyone may have written."""

from operator import methodcaller
from typing import Any, Final, Protocol

from ros2_kafka_bridge.endpoints import HeaderList

# confluent-kafka returns a broken list together with an exception where the name of a header is
# not UTF-8. A call from Python's own byte code may overlook that; one from C never does.
_ASK: Final = methodcaller('headers')
_SOURCE_TIME: Final = 'ros.source_time_ns'
_MOST_DIGITS: Final = 19


class HasHeaders(Protocol):
    """A record as far as it is looked at here."""

    def headers(self) -> Any:
        """Pairs of name and value, or None."""
        ...


def headers_of(record: HasHeaders) -> HeaderList | None:
    """Read its headers; None where the client cannot, for a name that is not UTF-8.

    Ask once for each record: the client keeps the broken list, and a look into it can end the
    process.
    """
    try:
        return _ASK(record) or []
    except (SystemError, UnicodeDecodeError):
        return None


def source_time_ns(headers: HeaderList) -> int:
    """When a ROS message was published, since 1970, as a bridge has noted it; 0 if none has."""
    for name, value in headers:
        if name == _SOURCE_TIME and value and len(value) <= _MOST_DIGITS and value.isdigit():
            return int(value)
    return 0
