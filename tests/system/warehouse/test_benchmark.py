"""The benchmark: its instances, its runs and its figures."""

import json
import random
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from ros2_kafka_warehouse.benchmark import instances, report
from ros2_kafka_warehouse.benchmark.cli import benchmark
from ros2_kafka_warehouse.benchmark.instances import (
    Instance,
    generate,
    large_warehouse,
    small_warehouse,
)
from ros2_kafka_warehouse.benchmark.runner import Crash, Outcome, run, run_for_ever
from ros2_kafka_warehouse.domain.grid import Distances, Grid
from ros2_kafka_warehouse.domain.maps import Job

app = typer.Typer()
app.command()(benchmark)
AISLE = ('e..r.e',)


def _small(rows: tuple[str, ...], starts: list[tuple[int, int]], jobs: list[Job]) -> Instance:
    return Instance('test', rows, tuple(starts), tuple(jobs))


def _frames(outcome: Outcome) -> list[dict[int, tuple[int, int, int | None]]]:
    return [
        {robot['id']: (robot['x'], robot['y'], robot['load']) for robot in row['robots']}
        for row in map(json.loads, outcome.trace)
    ]


def test_the_small_warehouse_is_of_the_published_kind() -> None:
    rows = small_warehouse(10, random.Random(0))  # noqa: S311
    text = ''.join(rows)
    assert (len(rows), {len(row) for row in rows}) == (21, {35})
    assert (text.count('@'), text.count('e'), text.count('r')) == (100, 302, 10)
    grid = Grid(rows)
    table = Distances(grid).to(grid.cells[0])
    assert all(table[grid.index(cell)] < float('inf') for cell in grid.cells)


def test_the_large_warehouse_is_of_the_published_kind() -> None:
    text = ''.join(large_warehouse())
    assert (len(large_warehouse()), {len(row) for row in large_warehouse()}) == (33, {46})
    assert (text.count('@'), text.count('e'), text.count('r')) == (240, 480, 192)


@pytest.mark.parametrize(
    ('frequency', 'first'),
    [(0.2, [0, 5, 10, 15]), (0.5, [0, 2, 4, 6]), (1, [0, 1, 2, 3]), (2, [0, 0, 1, 1])],
)
def test_tasks_are_released_evenly_between_different_endpoints(
    frequency: float, first: list[int]
) -> None:
    instance = generate(10, frequency, seed=1)
    assert len(instance.jobs) == 500
    assert [job.release for job in instance.jobs[:4]] == first
    assert all(job.pickup != job.delivery for job in instance.jobs)
    ends = {cell for job in instance.jobs for cell in (job.pickup, job.delivery)}
    assert {instance.rows[y][x] for x, y in ends} == {'e'}


def test_the_same_seed_gives_the_same_instance_and_the_same_trace() -> None:
    assert generate(20, 5, seed=3) == generate(20, 5, seed=3)
    assert generate(20, 5, seed=3) != generate(20, 5, seed=4)
    instance = generate(10, 10, seed=3)._replace(jobs=generate(10, 10, seed=3).jobs[:50])
    assert run(instance, seed=1).trace == run(instance, seed=1).trace


def test_the_trace_shows_each_load_from_its_pickup_to_its_delivery() -> None:
    instance = _small(AISLE, [(3, 0)], [Job(2, (0, 0), (5, 0))])
    outcome = run(instance)
    loads = [frame[0] for frame in _frames(outcome)]
    assert loads[:3] == [(3, 0, None)] * 3, 'it was not released'
    assert loads[5] == (0, 0, 0), 'taken in the row in which it stands on the pick-up'
    assert loads[9] == (4, 0, 0)
    assert loads[10] == (5, 0, None), 'given in the row in which it stands on the delivery'
    assert outcome.service == [8]
    assert outcome.makespan == 10
    assert json.loads(outcome.trace[0]) == {
        'step': 0,
        'robots': [{'id': 0, 'x': 3, 'y': 0, 'load': None}],
    }


@pytest.mark.parametrize(('frequency', 'robots'), report.PUBLISHED)
def test_the_mean_service_time_is_at_most_that_of_central_and_no_rule_is_broken(
    frequency: float, robots: int
) -> None:
    judged = report.validate(run(generate(robots, frequency, seed=5), seed=5))
    figures = report.as_json(judged)
    assert judged.violations == ()
    assert figures['delivered'] == 500
    assert figures['published']['to_central'] <= 1.05


@pytest.mark.parametrize('seed', range(4))
def test_with_crashed_robots_all_is_done_that_can_be_reached(seed: int) -> None:
    chance = random.Random(seed)  # noqa: S311
    crashes = [
        Crash(robot, step)
        for robot, step in zip(chance.sample(range(30), 3), (50, 120, 200), strict=True)
    ]
    outcome = run(generate(30, 2, seed), crashes, seed)
    assert report.validate(outcome).violations == ()
    assert outcome.left == ()
    assert len(outcome.delivered) + len(outcome.undone) == 500
    last = _frames(outcome)[-1]
    instance = outcome.instance
    blocked = frozenset(last[crash.robot][:2] for crash in crashes)
    distances = Distances(Grid(instance.rows), blocked)
    alive = [frame[:2] for robot, frame in last.items() if frame[:2] not in blocked]
    for number, why in outcome.undone.items():
        job = instance.jobs[number]
        ends = [job.pickup] if 'pick-up' in why else [job.delivery]
        assert all(distances.steps(cell, end) == float('inf') for cell in alive for end in ends)


def test_the_load_of_a_crashed_robot_is_taken_by_one_beside_it() -> None:
    rows = ('e....r', '...e.r')
    instance = _small(rows, [(1, 0), (5, 1)], [Job(0, (0, 0), (3, 1))])
    outcome = run(instance, [Crash(0, 2)])
    assert report.validate(outcome).violations == ()
    assert outcome.delivered.keys() == {0}
    frames = _frames(outcome)
    taken = next(step for step, frame in enumerate(frames) if frame[1][2] == 0)
    assert taken > 2
    assert frames[taken][0][2] is None, 'the load is there once only'
    (x, y, _), (other_x, other_y, _) = frames[taken][0], frames[taken][1]
    assert abs(x - other_x) + abs(y - other_y) == 1


@pytest.mark.parametrize(
    ('crash', 'why'),
    [
        (Crash(0, 0), 'no robot can reach its pick-up'),
        (Crash(1, 0), 'no robot can reach its delivery'),
    ],
)
def test_what_no_robot_can_reach_is_reported_with_the_reason(crash: Crash, why: str) -> None:
    instance = _small(('e.....e',), [(1, 0), (5, 0), (3, 0)], [Job(0, (0, 0), (6, 0))])
    outcome = run(instance, [crash])
    assert outcome.undone == {0: why}
    assert report.validate(outcome).is_good


def test_with_no_robot_left_the_run_ends() -> None:
    instance = _small(AISLE, [(3, 0)], [Job(0, (0, 0), (5, 0))])
    outcome = run(instance, [Crash(0, 1)])
    assert outcome.undone.keys() == {0}
    assert report.validate(outcome).is_good


def test_goals_without_end_are_counted_and_their_moves_are_valid() -> None:
    throughput = run_for_ever(large_warehouse(), 60, 150)
    assert report.validate_moves(throughput) == ()
    assert throughput.goals_a_step > 1


def test_public_files_are_read_and_their_figures_written(tmp_path: Path) -> None:
    instance = generate(10, 1, seed=2)
    grid = Grid(instance.rows)
    endpoints = [cell for cell in grid.cells if instance.rows[cell[1]][cell[0]] == 'e']
    (tmp_path / 'a.map').write_text('21,35\n302\n10\n900\n' + '\n'.join(instance.rows))
    (tmp_path / 'a.task').write_text(
        '500\n'
        + ''.join(
            f'{job.release} {endpoints.index(job.pickup)} {endpoints.index(job.delivery)} 0 0\n'
            for job in instance.jobs
        )
    )
    files = ['--map', f'{tmp_path}/a.map', '--tasks', f'{tmp_path}/a.task']
    result = CliRunner().invoke(
        app, [*files, '--json', f'{tmp_path}/a.json', '--trace', f'{tmp_path}/a.jsonl']
    )
    assert result.exit_code == 0, result.output
    assert '500/500' in result.output
    (figures,) = json.loads((tmp_path / 'a.json').read_text())
    assert (figures['robots'], figures['frequency'], figures['violations']) == (10, 1.0, [])
    assert figures['published']['central'] == 285.75
    assert len((tmp_path / 'a.jsonl').read_text().splitlines()) == figures['makespan'] + 1
    read = instances.read(tmp_path / 'a.map', tmp_path / 'a.task', None, 1, 0)
    assert (read.rows, read.jobs, read.starts) == (instance.rows, instance.jobs, instance.starts)


def test_a_movingai_scenario_is_a_list_of_tasks(tmp_path: Path) -> None:
    (tmp_path / 'a.map').write_text('type octile\nheight 2\nwidth 4\nmap\n....\n.@@.\n')
    (tmp_path / 'a.scen').write_text(
        'version 1\n0 a.map 4 2 0 0 3 1 4\n0 a.map 4 2 3 1 0 1 5\n0 a.map 4 2 0 1 3 0 4\n'
    )
    instance = instances.read_scene(tmp_path / 'a.map', tmp_path / 'a.scen', 1, 1)
    assert instance.starts == ((0, 0),)
    assert instance.jobs == (Job(0, (3, 1), (0, 1)), Job(1, (0, 1), (3, 0)))
    assert report.validate(run(instance)).is_good


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['--map', 'none.map'], 'none.map: cannot be read'),
        (['--tasks', 'a.task'], 'name it by --map'),
        (['--generate', '--map', 'a.map'], 'leave out --map'),
        (['--robots', '51'], 'holds 1 to 50 robots, not 51'),
        (['--frequency', '0'], 'the frequency must be more than 0'),
        (['--crash', 'third'], 'must be ROBOT@STEP'),
        (['--crash', '10@5', '--robots', '10'], 'the robots are 0 to 9'),
        (['--trace', 'a.jsonl'], '--trace is for one run'),
        (['--map', 'a.map', '--tasks', 'a.task', '--scen', 'a.scen'], '--tasks or --scen'),
    ],
)
def test_a_mistake_of_the_user_is_said_before_anything_runs(words: list[str], said: str) -> None:
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 2
    assert said in result.output
    assert 'Traceback' not in result.output


def test_a_broken_rule_or_a_task_that_was_left_is_an_exit_status_of_1(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def leaves_one(*args: object) -> Outcome:
        del args
        instance = generate(10, 10, seed=0)
        return Outcome(instance, (), {}, {}, (7,), (1.0,), ('{"step": 0, "robots": []}',))

    monkeypatch.setattr('ros2_kafka_warehouse.benchmark.runner.run', leaves_one)
    result = CliRunner().invoke(app, ['--robots', '10', '--frequency', '10'])
    assert result.exit_code == 1
    assert 'Not done, though it could be: [7]' in result.output
