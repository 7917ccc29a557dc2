"""Records that nobody should write: none ends the bridge, each is delivered or dead-lettered."""

from pathlib import Path

from confluent_kafka import Producer
from support.bridges.routes import lines, to_ros
from support.processes.harness import Bench, eventually

from benchmarks.fuzz import play

RECORDS = 5000


def test_each_fuzzed_record_is_delivered_or_dead_lettered_and_the_bridge_lives(
    bench: Bench,
) -> None:
    outcome = play(bench.bootstrap_servers, bench.place, bench.domain, seed=2, count=RECORDS)
    assert not outcome.bug
    for result in outcome.results:
        assert result.sound, result
        assert result.records == RECORDS // 2
        assert min(result.delivered, result.dead_letters) > RECORDS // 10


def test_a_batch_that_unpacks_to_too_much_fails_its_route_aloud_and_comes_once_it_may(
    bench: Bench, topic: str, arrived: Path
) -> None:
    producer = Producer(
        {
            'bootstrap.servers': bench.bootstrap_servers,
            'compression.type': 'zstd',
            'batch.size': 8_000_000,
            'message.max.bytes': 8_000_000,
            'linger.ms': 1000,
        }
    )
    for number in range(5):
        producer.produce(topic, str(number).rjust(900_000))
    assert producer.flush(30) == 0
    kafka = {
        'bootstrap.servers': bench.bootstrap_servers,
        'receive.message.max.bytes': 2_000_000,
        'fetch.max.bytes': 1_000_000,
    }
    route = to_ros(topic, '/numbers')
    with bench.subscriber('/numbers', arrived):
        with bench.drained(bench.config([route], kafka=kafka)) as bridge:
            bridge.wait_for('failed: ', 90)
            assert 'receive.message.max.bytes' in bridge.output()
        with bench.bridge(bench.config([route])) as bridge:
            eventually(lambda: len(lines(arrived)) >= 5, 90, bridge.output)
    assert [int(line) for line in lines(arrived)] == [0, 1, 2, 3, 4]
