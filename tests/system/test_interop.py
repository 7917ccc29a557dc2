"""The bridge among nodes whose DDS is of another vendor (Cyclone DDS)."""

from harness import Bench, eventually, headers, lines, to_kafka, to_ros, totals, values

COUNT = 1000
NUMBERS = [str(number) for number in range(COUNT)]


def test_a_writer_of_another_vendor_reaches_kafka_once_and_in_order_guarantees_2_3(
    bench: Bench, topic_name: str
) -> None:
    config = bench.config([to_kafka('/orders', topic_name)])
    with (
        bench.bridge(config) as bridge,
        bench.script('cyclone_writer.py', '/orders', '--count', str(COUNT)) as writer,
    ):
        writer.wait_for('published')
        records = bench.records(topic_name, COUNT)
        assert bridge.end() == 0
    assert values(records) == [number.encode() for number in NUMBERS]
    found = [headers(record) for record in records]
    assert [header['ros.seq'] for header in found] == [str(n) for n in range(1, COUNT + 1)]
    assert len({header['ros.gid'] for header in found}) == 1


def test_a_reader_of_another_vendor_gets_all_once_and_in_order_guarantees_1_3(
    bench: Bench, topic_name: str
) -> None:
    file = bench.place / 'received'
    config = bench.config([to_ros(topic_name, '/orders')])
    bench.produce(topic_name, [number.encode() for number in NUMBERS])
    with (
        bench.script('cyclone_reader.py', '/orders', str(file)),
        bench.bridge(config) as bridge,
    ):
        eventually(lambda: len(lines(file)) >= COUNT, 60, lambda: f'{len(lines(file))} came')
        # Confirmed, too: the other vendor's acknowledgements are understood.
        eventually(lambda: bench.committed(bench.group, topic_name) == COUNT, 60)
        assert bridge.end() == 0
    assert lines(file) == NUMBERS
    assert totals(bridge)['confirmed'] == COUNT
