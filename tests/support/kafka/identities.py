"""Records that carry the identity of a message, as a route writes them."""

from ros2_kafka_bridge.endpoints import HeaderList, Message
from ros2_kafka_bridge.route.identity import Author, make_identify
from ros2_kafka_bridge.route.labels import make_headers
from ros2_kafka_bridge.testing.memory import MemoryRecord

STRING = 'std_msgs/msg/String'
AUTHOR = Author('/orders', 'test', 'orders')
identify = make_identify(AUTHOR)


def headers_by(gid: bytes, seq: int, source_time_ns: int, author: Author = AUTHOR) -> HeaderList:
    """The headers of a record that this author makes of a message."""
    make = make_headers(author, STRING, lambda _: 'RIHS01_ab')
    return make(Message(b'', gid, seq, source_time_ns))


def record_by(gid: bytes, seq: int, source_time_ns: int, author: Author = AUTHOR) -> MemoryRecord:
    """A record that this author makes of a message."""
    return MemoryRecord(b'', header_list=headers_by(gid, seq, source_time_ns, author))
