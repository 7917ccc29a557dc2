"""A configuration that is changed while the bridge runs, in one process.

With workers and with monitoring, and all else about reloads: tests/system/test_reload.py.
"""

from contextlib import ExitStack
from functools import partial
from pathlib import Path

from harness import Bench, eventually, lines, to_kafka, to_ros, values
from numbers_to_kafka import how_many
from reloads import REFUSED, Reloaded
from workers import there_and_back

RATE = '300'


def numbered(count: int) -> list[bytes]:
    return [b'%d' % number for number in range(count)]


def test_a_reload_under_load_loses_and_repeats_nothing_on_the_routes_that_stay(
    bench: Bench, topic_name: str, tmp_path: Path
) -> None:
    """Numbers both ways, while another route changes, goes and comes back, again and again."""
    arrived, written, until = tmp_path / 'arrived', f'{topic_name}.written', tmp_path / 'until'
    other = f'{topic_name}.other'
    stay = [to_ros(topic_name, '/stays', max_rate=300), to_kafka('/numbers', written)]
    bench.create_topic(topic_name, written, other)
    kafka = bench.patient_kafka
    config = bench.config(stay, kafka=kafka)
    sent = 0
    with ExitStack() as stack:
        stack.enter_context(bench.subscriber('/stays', arrived))
        process = stack.enter_context(bench.bridge(config))
        process.wait_for('subscribes to', 60)
        publisher = bench.publisher('/numbers', '--until', str(until), '--rate', RATE)
        stack.enter_context(publisher)
        it = Reloaded(bench, process, config, kafka=kafka)
        b = [to_ros(other, '/b', name='b', max_rate=rate) for rate in (10, 20, 30)]
        for routes, said in (
            ([*stay, b[0]], 'started b'),
            ([*stay, b[1]], 'restarted b'),
            ([*stay, b[2]], 'restarted b'),
            (stay, 'ended b'),
            (stay, 'nothing has changed'),
        ):
            bench.produce(topic_name, numbered(sent + 1000)[sent:])
            sent += 1000
            goal = bench.end_offset(written) + 100
            eventually(partial(bench.reaches, written, goal), 90, process.output)
            assert it.to(routes) == said
        until.touch()
        publisher.wait_for('published ', 60)
        count = how_many(publisher)
        eventually(lambda: str(sent - 1) in lines(arrived)[-1:], 120, process.output)
        records = bench.records(written, count, timeout_s=120)
        assert process.end(40) == 0, process.output()
    assert values(records) == numbered(count), 'nothing is lost, repeated or out of order'
    assert [int(line) for line in lines(arrived)] == list(range(sent))
    assert process.output().count('to_ros: reads') == 1
    assert process.output().count('subscribes to') == 1


def test_a_bad_file_is_refused_with_every_mistake_and_all_goes_on(
    bench: Bench, topic: str, returned: str
) -> None:
    routes = there_and_back(topic)
    config = bench.config(routes)
    with bench.drained(config) as process:
        process.wait_for('reads ', 60)
        process.wait_for('subscribes to', 60)
        it = Reloaded(bench, process, config)
        bad = [to_ros(topic, 'no slash'), to_kafka('/orders', returned, format='xml')]
        it.write(bad)
        it.ask()
        process.wait_for(REFUSED, 60)
        assert 'routes[0].to.ros: ' in process.output()
        assert 'routes[1].format: ' in process.output()
        config.write_text('a: [')
        it.ask()
        process.wait_for(REFUSED, 60, count=2)
        config.unlink()
        it.ask()
        process.wait_for(REFUSED, 60, count=3)
        assert 'no such file' in process.output()
        bench.produce(topic, numbered(10))
        eventually(partial(bench.reaches, returned, 10), 60, process.output)
        assert it.to(routes) == 'nothing has changed'
    assert 'Traceback' not in process.output()
    assert process.output().count('subscribes to') == 1
