"""Middlewares that bound no history are tried by a reader that is stopped: who lies is found.

`tests/peers/stranger.c` makes Fast DDS one of them. `tests/integration/test_confirmation.py` has
one that is bounded, and what a route does then.
"""

import os
import re
import signal
from pathlib import Path

import pytest
from support.bridges.letters import SMALL, done, long, route
from support.bridges.routes import lines, to_ros, totals
from support.bridges.words import ROS_TOPIC, texts, wait_for, words
from support.processes.harness import Bench, Process, eventually
from support.processes.preloads import stranger, tried_by

LIES = 'rmw_stranger does not tell what has arrived: it denied nothing of a message'
ALONE = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'}


@pytest.fixture
def config(bench: Bench, topic: str) -> Path:
    """A route to ROS, with 100 records to come."""
    bench.produce(topic, words(100))
    return bench.config([to_ros(topic, ROS_TOPIC)])


def stopped_reader(bridge: Process) -> int:
    """Wait until the reader of a bridge stands still."""
    found: list[int] = []

    def is_stopped() -> bool:
        for reader in tried_by(bridge.pid):
            state = Path(f'/proc/{reader}/stat').read_text().rpartition(')')[2].split()[0]
            found.extend([reader] * (state == 'T'))
        return bool(found)

    eventually(is_stopped, 60, bridge.output)
    return found[0]


def test_guarantee_6c_a_lie_is_found_where_no_history_is_bounded(
    bench: Bench, topic_name: str, config: Path, tmp_path: Path
) -> None:
    lies = stranger(bench.place, 'lies unbounded')
    with (
        bench.subscriber(ROS_TOPIC, tmp_path / 'arrived'),
        bench.drained(config, **lies) as bridge,
    ):
        bridge.wait_for(f'to_ros: failed: {LIES}')
        assert bench.committed(bench.group, topic_name) < 0
        assert tried_by(bridge.pid) == []


def test_guarantee_6c_who_tells_the_truth_is_believed_where_no_history_is_bounded(
    bench: Bench, config: Path, arrived: Path
) -> None:
    honest = stranger(bench.place, 'unbounded')
    with bench.subscriber(ROS_TOPIC, arrived), bench.drained(config, **honest) as bridge:
        bridge.wait_for('this middleware does not bound a KEEP_ALL history')
        wait_for(arrived, texts(words(100)), bridge)
        assert tried_by(bridge.pid) == []
    assert totals(bridge)['confirmed'] == 100


def test_no_reader_is_started_where_the_history_is_bounded(
    bench: Bench, config: Path, arrived: Path
) -> None:
    with bench.subscriber(ROS_TOPIC, arrived), bench.bridge(config) as bridge:
        eventually(lambda: len(lines(arrived)) > 0 or tried_by(bridge.pid) != [], 60)
        assert tried_by(bridge.pid) == []
        wait_for(arrived, texts(words(100)), bridge)


def test_guarantee_6c_what_could_not_be_tried_is_not_known_and_commits_nothing(
    bench: Bench, topic_name: str, config: Path
) -> None:
    """And it is tried again; a stop does not wait for it."""
    alone = stranger(bench.place, 'unbounded') | ALONE
    with bench.bridge(config, **alone) as bridge:
        bridge.wait_for(
            'to_ros: failed: it is not known whether rmw_stranger tells what has arrived: the '
            'reader that was to show it was not discovered within 10 s'
        )
        eventually(lambda: bool(tried_by(bridge.pid)), 30, bridge.output)
        assert bridge.end() == 0
        assert bench.committed(bench.group, topic_name) < 0
    assert 'gave up' not in bridge.output()


def test_a_reader_that_is_stopped_goes_with_a_bridge_that_is_killed(
    bench: Bench, config: Path
) -> None:
    honest = stranger(bench.place, 'unbounded')
    with bench.bridge(config, **honest) as bridge:
        reader = stopped_reader(bridge)
        os.kill(bridge.pid, signal.SIGKILL)
        eventually(lambda: not Path(f'/proc/{reader}').exists(), 20, bridge.output)


@pytest.mark.parametrize('ways', ['lies', 'lies unbounded'])
def test_guarantee_6c_check_says_it_before(bench: Bench, config: Path, ways: str) -> None:
    lies = stranger(bench.place, ways)
    status, out, _ = bench.command('check', str(config), '--connect', **lies)
    assert status == 1
    assert re.search(rf'BAD +{LIES}.*ros: {{confirmation: none}}', out), out
    assert '1 cannot run as it is' in out


def test_check_says_what_confirmation_none_gives_up_where_it_is_not_needed(
    bench: Bench, topic: str
) -> None:
    config = bench.config([to_ros(topic, ROS_TOPIC)], ros={'confirmation': 'none'})
    status, out, _ = bench.command('check', str(config), '--connect')
    assert status == 0
    assert 'ros.confirmation: none: guarantee 1 falls' in out
    assert 'note nobody asks what has arrived (ros.confirmation)' in out


def test_guarantee_6c_no_letter_is_marked_as_sent_that_nothing_confirms(
    bench: Bench, topic: str, tmp_path: Path
) -> None:
    """Also where the routes themselves ask nobody."""
    bench.produce(topic, [long(1)])
    with bench.drained(bench.config([route(topic, SMALL)])):
        assert len(bench.records(f'{topic}.dead-letters', 1)) == 1
    config = bench.config([route(topic)], ros={'confirmation': 'none'})
    replay = ('dead-letters', 'replay', str(config), '--all', '--to', 'ros')
    with bench.subscriber(ROS_TOPIC, tmp_path / 'arrived'):
        status, out, errors = bench.command(*replay, **stranger(bench.place, 'lies'))
    assert status == 1
    assert LIES in out + errors
    assert 'without --to ros letters go to their topic' in out + errors
    assert '1 letter' in done(bench, 'replay', config, '--all', '--dry-run')


def test_a_reader_that_somebody_lets_go_on_condemns_nobody(
    bench: Bench, config: Path, arrived: Path
) -> None:
    """What it acknowledges then is no lie: it is tried again."""
    honest = stranger(bench.place, 'unbounded')
    with bench.subscriber(ROS_TOPIC, arrived), bench.drained(config, **honest) as bridge:
        os.kill(stopped_reader(bridge), signal.SIGCONT)
        wait_for(arrived, texts(words(100)), bridge)
    assert LIES not in bridge.output()
    assert totals(bridge)['confirmed'] == 100
