"""Programs that write the headers of the bridge into records of their own."""

from collections.abc import Iterable

from confluent_kafka import Message
from support.processes.harness import Bench

from ros2_kafka_bridge.endpoints import HeaderList, headers_of


def copied(record: Message) -> HeaderList:
    """What a stream processor hands on with what it makes of a record: all its headers."""
    return headers_of(record) or []


def forge(bench: Bench, topic: str, known: Message, numbers: Iterable[int]) -> None:
    """Write records with numbers of the publisher of a known one, and all that is public of it.

    Each number comes with the time of the known record, with one a second later for each further
    number, as one who has watched the publisher would guess it, and bare.
    """
    told = copied(known)
    first = int(dict(told)['ros.seq'] or 0)
    made_ns = int(dict(told)['ros.source_time_ns'] or 0)
    for number in numbers:
        guess_ns = made_ns + 1_000_000_000 * (number - first)
        seq = b'%d' % number
        bare = [one for one in told if one[0] == 'ros.gid']
        for time_ns in (made_ns, guess_ns):
            own = {'ros.seq': seq, 'ros.source_time_ns': b'%d' % time_ns}
            headers = [(name, own.get(name, value)) for name, value in told]
            bench.produce(topic, [b'forged'], headers=headers)
        bench.produce(topic, [b'forged'], headers=[*bare, ('ros.seq', seq)])


def true_ones(bench: Bench, topic: str) -> list[Message]:
    """The records that no stranger has written: a bridge has written numbers."""
    found = bench.records(topic, bench.end_offset(topic))
    return [record for record in found if (record.value() or b'').isdigit()]
