"""Several workers as their users meet them: once and in order, balanced, started again."""

from functools import partial
from itertools import islice, pairwise

from support.bridges.numbers_to_ros import numbered
from support.bridges.routes import totals, values
from support.bridges.workers import (
    Watched,
    bridge,
    kill,
    pids,
    sized,
    stream,
    there_and_back,
    wait_until_gone,
)
from support.processes.harness import Bench, eventually

from ros2_kafka_bridge.route.counters import Snapshot, State, from_line

BACKLOG = 15_000


def test_guarantee_7_records_through_two_workers_arrive_once_over_a_stop_in_mid_stream(
    bench: Bench, topic: str, returned: str
) -> None:
    """The first two are stopped while records go on to come; the next two have a backlog."""
    config = bench.config(there_and_back(topic), workers=2, kafka=bench.patient_kafka)
    with stream(bench, topic) as records, bridge(bench, config) as process:
        eventually(partial(bench.reaches, returned, 1000), 60, process.output)
        assert process.end() == 0, process.output()
        committed = bench.committed(bench.group, topic)
        assert bench.end_offset(returned) == committed
        records.wait_beyond(committed)
        records.end()
    confirmed = totals(process)['confirmed'], totals(process, 'to_kafka')['confirmed']
    assert confirmed == (committed, committed)
    assert process.output().count('stopping: draining') == 1
    wait_until_gone(*pids(process, 1), *pids(process, 2))
    count = records.sent + BACKLOG
    bench.produce(topic, islice(sized(count), records.sent, None))
    with bridge(bench, config) as process:
        received = values(bench.records(returned, count, timeout_s=90))
        assert process.end() == 0, process.output()
    assert received == sized(count)


def test_snapshots_of_a_worker_balance_under_load_and_the_last_one_comes_after_the_drain(
    bench: Bench, topic: str, returned: str
) -> None:
    config = bench.config(there_and_back(topic), kafka=bench.patient_kafka)
    with stream(bench, topic) as records, Watched(bench, config) as watched:
        heard = map(from_line, watched.lines())
        found = [next(heard)]
        while sum(to_kafka_.confirmed > 0 for _, to_kafka_ in found) < 3:
            found.append(next(heard))
        watched.process.terminate()
        found += heard
        assert watched.end() == 0
        records.wait_beyond(found[-1][0].confirmed)
        records.end()
    assert all([s.route for s in every] == ['to_ros', 'to_kafka'] for every in found)
    assert all(snapshot.balanced for every in found for snapshot in every), found
    for before, after in pairwise(found):
        assert all(a.taken >= b.taken for a, b in zip(after, before, strict=True))
    assert states(found[-1]) == {State.STOPPED}
    to_ros_, to_kafka_ = found[-1]
    assert to_ros_.confirmed == bench.committed(bench.group, topic)
    assert to_kafka_.confirmed == bench.end_offset(returned)


def states(snapshots: list[Snapshot]) -> set[State]:
    return {snapshot.state for snapshot in snapshots}


def test_a_worker_that_is_started_again_runs_what_the_file_held_at_the_start(
    bench: Bench, topic: str, returned: str
) -> None:
    """Though somebody edits the file just now, and a secret was mounted for the start alone."""
    routes = there_and_back(topic)
    named = bench.place / 'broker'
    named.write_text(bench.bootstrap_servers)
    config = bench.config(routes, workers=2, kafka={'bootstrap.servers': '${file:broker}'})
    bench.produce(topic, numbered(100))
    with bench.drained(config) as process:
        eventually(partial(bench.reaches, returned, 100), 90, process.output)
        eventually(lambda: bench.committed(bench.group, topic) == 100, 60, process.output)
        named.unlink()
        config.write_text('name: half of a')  # somebody edits it just now
        kill(process, 1)
        bench.produce(topic, numbered(200)[100:])
        eventually(lambda: bench.committed(bench.group, topic) == 200, 60, process.output)
    assert process.output().count(f'bridge {bench.name}, worker 1, runs') == 2
    assert values(bench.records(returned, 200)) == numbered(200)
