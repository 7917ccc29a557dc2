"""A floor that keeps the rules is never accused, however it begins; one thing wrong is found."""

from collections.abc import Callable
from dataclasses import dataclass, field
from random import Random
from typing import Any, NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.warehouse.referee_cases import (
    AT_STOCK,
    FREE,
    HOMES,
    RULES,
    TEA,
    WITH_TEA,
    judged,
    robot,
)

from ros2_kafka_warehouse.domain.referee import Referee
from ros2_kafka_warehouse.domain.rules import Frame, Job, Seen
from ros2_kafka_warehouse.messages.message import Cell


def test_a_floor_that_started_again_is_taken_as_it_is() -> None:
    referee = Referee(RULES)
    referee.loads.know(TEA)
    for step, seen in ((5, AT_STOCK), (6, WITH_TEA), (7, robot('a', (1, 2), loads=('1/tea',)))):
        assert referee.check(Frame(step, 9.0, (seen,))) == ()
    # The fleet knows only the state of step 5, and does it all once more.
    for step, seen in ((6, AT_STOCK), (7, WITH_TEA), (8, robot('a', (1, 2), loads=('1/tea',)))):
        assert referee.check(Frame(step, 9.0, (seen,))) == ()


def test_a_robot_that_drives_in_the_first_frame_may_arrive_in_the_next() -> None:
    assert judged((robot('h', (0, 0), (1, 0)),), (robot('h', (1, 0)),)) == []


def test_frames_that_were_missed_raise_no_alarm() -> None:
    referee = Referee(RULES)
    assert referee.check(Frame(1, 0.0, (robot('a', (0, 0)), robot('b', (1, 0))))) == ()
    assert referee.check(Frame(9, 0.0, (robot('a', (1, 0)), robot('b', (0, 0))))) == ()
    far = Frame(10, 0.0, (robot('a', (2, 0)), robot('b', (4, 0))))
    assert [violation.rule for violation in referee.check(far)] == ['teleport']


def test_what_was_undone_by_a_floor_that_started_again_later_raises_no_alarm() -> None:
    referee = Referee(RULES)
    referee.loads.know(TEA)
    for step, seen in ((5, AT_STOCK), (6, WITH_TEA)):
        assert referee.check(Frame(step, 9.0, (seen,))) == ()
    for step, seen in ((15, AT_STOCK), (16, WITH_TEA)):
        assert referee.check(Frame(step, 9.0, (seen,))) == ()


@dataclass
class Floor:
    """Plays a floor by the rules, at random: the other side of the validator's bet."""

    random: Random
    jobs: list[Job] = field(default_factory=list)
    robots: dict[str, Seen] = field(default_factory=dict)
    waits: list[Job] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.robots = {name: robot(name, home) for name, home in HOMES.items()}
        for number in range(12):
            source, delivery = self.random.sample(FREE, 2)
            job = Job(f'{number}/x', frozenset({source}), delivery, 0.0, 10.0, 'small')
            self.jobs.append(job)
        self.waits = list(self.jobs)

    def frames(self, steps: int) -> list[Frame]:
        frames = [Frame(0, 0.0, tuple(self.robots.values()))]
        for step in range(1, steps):
            held = {cell: name for name, seen in self.robots.items() for cell in seen.cells}
            for name in self.random.sample(sorted(self.robots), len(self.robots)):
                before = self.robots[name]
                seen = self._act(before) or self._drive(before, held)
                self.robots[name] = seen
                held.update(dict.fromkeys(seen.cells, name))
            frames.append(Frame(step, float(step), tuple(self.robots.values())))
        return frames

    def _act(self, seen: Seen) -> Seen | None:
        if len(seen.cells) > 1:
            return None
        for job in self.jobs:
            if seen.loads == (job.task_id,) and seen.cells == (job.delivery,):
                return seen._replace(loads=())
        for job in self.waits:
            if not seen.loads and seen.cells[0] in job.sources:
                self.waits.remove(job)
                return seen._replace(loads=(job.task_id,))
        return None

    def _drive(self, seen: Seen, held: dict[Cell, str]) -> Seen:
        if len(seen.cells) > 1:
            return seen._replace(cells=seen.cells[1:])
        x, y = seen.cells[0]
        ways = [
            cell
            for cell in ((x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1))
            if cell in FREE and cell not in held
        ]
        if not ways or self.random.random() < 0.2:
            return seen
        cell = self.random.choice(ways)
        return seen._replace(cells=((x, y), cell) if seen.type == 'hauler' else (cell,))


def dice(seed: int) -> Random:
    return Random(seed)  # noqa: S311 - no secret


def rules_broken(jobs: list[Job], frames: list[Frame]) -> set[str]:
    referee = Referee(RULES)
    for job in jobs:
        referee.loads.know(job)
    return {violation.rule for frame in frames for violation in referee.check(frame)}


@settings(max_examples=60)
@given(st.integers(0, 2**32))
def test_a_floor_that_keeps_the_rules_is_never_accused(seed: int) -> None:
    floor = Floor(dice(seed))
    frames = floor.frames(120)
    assert rules_broken(floor.jobs, frames) == set()


class Play(NamedTuple):
    """What a mutation may change, and its dice."""

    random: Random
    frames: list[Frame]
    jobs: list[Job]


Mutation = Callable[[Play], set[str] | None]


def change(frames: list[Frame], at: int, name: str, **more: Any) -> None:
    frames[at] = frames[at]._replace(
        robots=tuple(
            seen._replace(**more) if seen.robot == name else seen for seen in frames[at].robots
        )
    )


def any_robot(play: Play) -> tuple[int, Seen]:
    at = play.random.randrange(1, len(play.frames) - 1)
    return at, play.random.choice(play.frames[at].robots)


def put_into_a_wall(play: Play) -> set[str]:
    at, seen = any_robot(play)
    change(play.frames, at, seen.robot, cells=((1, 1),))
    return {'wall'}


def put_onto_another(play: Play) -> set[str]:
    at, seen = any_robot(play)
    other = play.random.choice([one for one in play.frames[at].robots if one.robot != seen.robot])
    change(play.frames, at, seen.robot, cells=other.cells)
    return {'collision'}


def jump(play: Play) -> set[str] | None:
    at, seen = any_robot(play)
    start = play.frames[at - 1].robots
    x, y = next(one.cells[0] for one in start if one.robot == seen.robot)
    far = [cell for cell in FREE if abs(cell[0] - x) + abs(cell[1] - y) > 2]
    change(play.frames, at, seen.robot, cells=(play.random.choice(far),))
    return {'teleport'}


def lose_a_load(play: Play) -> set[str] | None:
    places = [
        (at, seen)
        for at, frame in enumerate(play.frames[1:], 1)
        for seen in frame.robots
        if seen.loads
        and seen.cells
        != (next(job for job in play.jobs if job.task_id == seen.loads[0]).delivery,)
        and any(one.robot == seen.robot and one.loads for one in play.frames[at - 1].robots)
    ]
    if not places:
        return None
    at, seen = play.random.choice(places)
    for later in range(at, len(play.frames)):
        now = next(one for one in play.frames[later].robots if one.robot == seen.robot)
        if now.loads != seen.loads:
            break
        change(play.frames, later, seen.robot, loads=())
    return {'drop'}


def double_a_load(play: Play) -> set[str] | None:
    places = [
        (at, seen, other)
        for at, frame in enumerate(play.frames)
        for seen in frame.robots
        for other in frame.robots
        if seen.loads and not other.loads and at
    ]
    if not places:
        return None
    at, seen, other = play.random.choice(places)
    change(play.frames, at, other.robot, loads=seen.loads)
    return {'doubled', 'taken', 'source'}


def pick_from_afar(play: Play) -> set[str] | None:
    picked = {load for frame in play.frames for seen in frame.robots for load in seen.loads}
    free = [job for job in play.jobs if job.task_id not in picked]
    at, seen = any_robot(play)
    if not free or seen.loads or seen.cells[0] in free[0].sources:
        return None
    change(play.frames, at, seen.robot, loads=(free[0].task_id,))
    return {'source'}


def deliver_again(play: Play) -> set[str] | None:
    for at, frame in enumerate(play.frames[1:], 1):
        for seen in frame.robots:
            before = next(one for one in play.frames[at - 1].robots if one.robot == seen.robot)
            if before.loads and not seen.loads and at + 1 < len(play.frames):
                play.frames.insert(at + 1, frame)
                play.frames[at + 1 :] = [
                    later._replace(step=number)
                    for number, later in enumerate(play.frames[at + 1 :], at + 1)
                ]
                change(play.frames, at + 1, seen.robot, loads=before.loads)
                return {'repeated'}
    return None


def release_later(play: Play) -> set[str] | None:
    for frame in play.frames:
        for seen in frame.robots:
            for number, job in enumerate(play.jobs):
                if seen.loads == (job.task_id,):
                    play.jobs[number] = job._replace(
                        released_s=frame.time_s + play.random.uniform(0.1, 9)
                    )
                    return {'release'}
    return None


def make_it_heavy(play: Play) -> set[str] | None:
    for frame in play.frames:
        for seen in frame.robots:
            for number, job in enumerate(play.jobs):
                if seen.loads == (job.task_id,):
                    play.jobs[number] = job._replace(weight_kg=play.random.uniform(121, 999))
                    return {'weight'}
    return None


def set_a_pallet_in_the_way(play: Play) -> set[str] | None:
    for at in range(1, len(play.frames)):
        for before, seen in zip(play.frames[at - 1].robots, play.frames[at].robots, strict=True):
            new = [cell for cell in seen.cells if cell not in before.cells]
            if new and play.random.random() < 0.2:
                for number in (at - 1, at):
                    play.frames[number] = play.frames[number]._replace(pallets=frozenset(new))
                return {'pallet'}
    return None


def empty_the_battery(play: Play) -> set[str]:
    for name in HOMES:
        for at in range(len(play.frames)):
            change(play.frames, at, name, charge=0.0)
    return {'battery'}


@pytest.mark.parametrize(
    'mutation',
    [
        put_into_a_wall, put_onto_another, jump, lose_a_load, double_a_load, pick_from_afar,
        deliver_again, release_later, make_it_heavy, set_a_pallet_in_the_way, empty_the_battery,
    ],
)  # fmt: skip
@settings(max_examples=30)
@given(st.integers(0, 2**32))
def test_one_thing_wrong_in_a_random_floor_is_found(mutation: Mutation, seed: int) -> None:
    floor = Floor(dice(seed))
    play = Play(dice(seed), floor.frames(120), list(floor.jobs))
    expected = mutation(play)
    if expected is not None:
        assert rules_broken(play.jobs, play.frames) & expected
