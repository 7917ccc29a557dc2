"""What the fault bench runs on and tells, without Kafka and ROS."""

import json
import shutil
from pathlib import Path

import pytest
from rich.console import Console

from benchmarks.faults import __main__ as bench
from benchmarks.faults import said
from benchmarks.faults.checker import Verdict, Window, summed
from benchmarks.faults.compare import main
from benchmarks.faults.faults import FAULTS
from benchmarks.faults.memberships import MEMBERSHIPS
from benchmarks.faults.parts import end
from benchmarks.faults.report import keep, show
from benchmarks.faults.run import AROUND, Outcome, allowed
from benchmarks.faults.setting import Setting
from benchmarks.faults.streams import FROM_KAFKA, LATCHED, STREAMS, configuration
from rig.processes import Programs
from ros2_kafka_bridge.config.file import loads
from ros2_kafka_bridge.kafka.property_check import property_problems

STANDS_STILL = """
import signal
import time

def stands_still():
    print('here', flush=True)
    while True:
        time.sleep(1)

signal.signal(signal.SIGTERM, signal.SIG_IGN)
stands_still()
"""


@pytest.mark.parametrize('name', MEMBERSHIPS)
def test_a_bridge_takes_the_configuration_of_every_membership(name: str, tmp_path: Path) -> None:
    streams = list(STREAMS.values())
    content = configuration('k:9092', streams, tmp_path, MEMBERSHIPS[name], is_exclusive=True)
    config = loads(json.dumps(content), 'bridge.yaml', {})
    assert property_problems(dict(config.kafka)) == {}
    assert config.membership == ('dynamic' if name == 'dynamic' else 'static')
    assert ('group.protocol' in config.kafka) == name.startswith('consumer')


def test_a_part_that_does_not_end_leaves_what_it_was_at_beside_its_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    which = shutil.which
    monkeypatch.setattr(shutil, 'which', lambda name: None if name == 'gdb' else which(name))
    part = Programs(tmp_path, {}).python('bridge', '-c', STANDS_STILL)
    part.start()
    part.wait_for('here')
    assert end(part, 0.2) is None
    assert not part.running
    told = (tmp_path / 'bridge.stacks').read_text()
    if 'Permission denied' in told:
        pytest.skip('this machine lets nobody look into a process (ptrace)')
    assert 'stands_still' in told
    assert 'is not here' in told


def a_run(place: Path, membership: str, verdicts: list[dict[str, object]]) -> str:
    place.mkdir()
    told = {'setting': {'membership': membership}, 'verdicts': verdicts}
    (place / 'faults.json').write_text(json.dumps(told))
    return str(place)


def verdict(fault: str, stall_s: float, recovery_s: float | None) -> dict[str, object]:
    return {
        'stream': 'to_ros', 'fault': fault, 'lost': 0, 'duplicated': 2,
        'stall_s': stall_s, 'recovery_s': recovery_s,
    }  # fmt: skip


def test_runs_stand_side_by_side_with_every_time_of_every_fault(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where another takes over it is the stall that counts, else the time from the return on."""
    static = [verdict('broker_kill', 9.0, 2.04), verdict('none', 0.1, None)]
    static += [verdict('take_over', 6.2, 6.1), verdict('broker_kill', 9.0, 1.0)]
    dynamic = [verdict('broker_kill', 9.0, None), verdict('broker_kill', 9.0, 6.3)]
    runs = [a_run(tmp_path / 'a', 'static', static), a_run(tmp_path / 'b', 'dynamic', dynamic)]
    assert main(runs) == 0
    assert capsys.readouterr().out.splitlines() == [
        '|  | static, session 6 s | dynamic, session 6 s |',
        '|---|---|---|',
        '| Kafka -> ROS: every broker SIGKILLed, and started again | 1.0 2.0 | 6.3 > |',
        '| Kafka -> ROS: one bridge of two SIGKILLed, the other one takes over | 6.2 |  |',
        '| Kafka -> ROS: lost, repeated | 0, 8 | 0, 4 |',
    ]


def test_a_run_that_has_not_come_to_its_end_is_one_sentence(tmp_path: Path) -> None:
    file = tmp_path / 'faults.json'
    file.write_text('{"setting": {"membership": "static"}}')
    with pytest.raises(SystemExit, match='is no run that has come to its end'):
        main([str(file)])
    with pytest.raises(SystemExit, match='holds 0 files'):
        main([str(tmp_path / 'nowhere')])


def test_a_stream_tells_how_long_it_took_to_flow_again_and_how_those_times_lie(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    found = [Verdict('to_ros', 'broker_kill', 9, 0, 0, 0, 0, 9.0, s, []) for s in (0.5, 2.0, 0.7)]
    outcome = Outcome([summed(found, 5.0, '')], found, [], 3, [])
    show(Console(width=140), outcome)
    told = (
        'flows again: 0.50 s at least, 0.70 s in the median, 2.00 s in 95 of 100, 2.00 s at most'
    )
    assert f'broker_kill, {told}' in capsys.readouterr().out
    keep(tmp_path / 'faults.json', {}, [], outcome)
    [row] = json.loads((tmp_path / 'faults.json').read_text())['rows']
    assert row['recoveries'] == {'least_s': 0.5, 'median_s': 0.7, 'p95_s': 2.0, 'most_s': 2.0}


def test_each_of_two_bridges_may_publish_its_own_window_behind_later_orders() -> None:
    killed = Window('subscriber_kill', 0, None, 1)
    one, two = (allowed(FROM_KAFKA, killed, bridges) for bridges in (1, 2))
    assert two.out_of_order == 2 * one.out_of_order > 0
    assert two.lost == one.lost, 'the dead subscriber had one cache'
    assert allowed(FROM_KAFKA, Window(AROUND, 0, None, 1), 2).out_of_order == 0
    for name, fault in FAULTS.items():
        if 'one bridge' not in fault.needs:
            of_one = [allowed(LATCHED, Window(name, 0, None, 1), bridges) for bridges in (1, 2)]
            assert of_one[0] == of_one[1], 'from ROS only one bridge carries it at a time'


@pytest.mark.parametrize(
    ('stream', 'left_out'),
    [
        ('to_ros', ['publisher_kill']),
        ('latched', ['subscriber_kill', 'rebalance_storm', 'clock']),
    ],
)
def test_a_fault_is_left_out_where_none_of_the_streams_can_meet_it(
    stream: str, left_out: list[str], tmp_path: Path
) -> None:
    all_there = bench.abilities(Setting(tmp_path, tuple(STREAMS.values()), 1.0, 1, 1, 3))
    there = bench.abilities(Setting(tmp_path, (STREAMS[stream],), 1.0, 1, 1, 3))
    lost = {name for name, fault in FAULTS.items() if fault.needs in all_there - there}
    assert lost == set(left_out)


def test_a_run_without_any_fault_that_can_be_done_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """And does not look for one for ever."""
    words = ['--streams', 'latched', '--faults', 'subscriber_kill', '--hosts', 'no']
    assert bench.main([*words, '--out', str(tmp_path)]) == 2
    told = capsys.readouterr().out
    assert 'left out, for it needs the stream to_ros: subscriber_kill' in told
    assert 'none of the faults can be done here' in told


def test_who_stands_still_keeps_the_spool_that_both_bridges_of_a_machine_share() -> None:
    """docs/high-availability.md says so; a dead one keeps nothing."""
    stopped, killed = FAULTS['take_over_stop'], FAULTS['take_over']
    assert stopped.limit_s(STREAMS['spooled']) is None
    assert stopped.limit_s(LATCHED) == killed.limit_s(STREAMS['spooled']) == 10.0


def test_a_route_that_waits_for_its_spool_is_still_being_handed_over() -> None:
    says = '2026-11-27 09:42:{},000 INFO    spooled: {}'
    its_turn = 'its turn has come, but process 7 still has the spool /spools/a.spool.lock'
    lines = [
        says.format('10', 'takes over: this bridge runs the route'),
        says.format('12', 'takes over: this bridge runs the route'),
        says.format('13', its_turn),
        says.format('42', f'waiting ({its_turn}): 0 confirmed, 0/s, 0 in flight'),
        says.format('43', 'running: 10 confirmed, 1/s, 0 in flight'),
    ]
    found = said.hand_overs_ns('spooled', lines, is_from_kafka=False)
    assert [(at - found[0]) // 10**9 for at in found] == [0, 1, 30]
