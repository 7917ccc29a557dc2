"""A middleware whose acknowledgements prove nothing (`tests/peers/stranger.c`), in real bridges.

`tests/system/test_confirmation.py` has those whose histories have no bound.
"""

from pathlib import Path

from support.bridges.routes import to_ros, totals, values
from support.bridges.words import ROS_TOPIC, texts, wait_for, wait_for_commit, words
from support.processes.harness import Bench
from support.processes.preloads import stranger
from support.ros.raw import publish, route, text

LIES = 'rmw_stranger does not tell what has arrived: it denied nothing of a message'


def test_guarantee_6c_where_acknowledgements_are_lies_nothing_is_committed_by_them(
    bench: Bench, topic: str, arrived: Path
) -> None:
    """The route to ROS fails, that from ROS goes on."""
    back = f'{topic}.back'
    bench.produce(topic, words(10))
    config = bench.config([to_ros(topic, ROS_TOPIC), route('/back', back, None, 'back')])
    lies = stranger(bench.place, 'lies')
    with bench.subscriber(ROS_TOPIC, arrived), bench.drained(config, **lies) as bridge:
        bridge.wait_for(f'to_ros: failed: {LIES}')
        with publish(bench, '/back', [text(b'a')], '--durability', 'transient_local'):
            assert values(bench.records(back, 1)) == [text(b'a')]
        assert bench.committed(bench.group, topic) < 0


def test_guarantee_6c_with_confirmation_none_offsets_follow_and_nothing_counts_as_confirmed(
    bench: Bench, topic: str, arrived: Path
) -> None:
    bench.produce(topic, words(100))
    config = bench.config([to_ros(topic, ROS_TOPIC)], ros={'confirmation': 'none'})
    lies = stranger(bench.place, 'lies')
    with bench.subscriber(ROS_TOPIC, arrived), bench.drained(config, **lies) as bridge:
        bridge.wait_for('ros.confirmation: none: guarantee 1 falls')
        wait_for(arrived, texts(words(100)), bridge)
        wait_for_commit(bench, topic, 100, bridge)
    assert (totals(bridge)['confirmed'], totals(bridge)['only published']) == (0, 100)
