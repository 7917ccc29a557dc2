"""A trace in JSON lines, judged by the rules: from a simulation of ours, or of anybody."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Final

import msgspec
from msgspec.structs import replace

from ros2_kafka_warehouse.domain.referee import Referee
from ros2_kafka_warehouse.domain.rules import Frame, Job, Rules, Seen
from ros2_kafka_warehouse.messages.message import Cell
from ros2_kafka_warehouse.messages.onlookers import Violation

WALLS: Final = '@TOW'
SILENT: Final = 20  # steps until a floor that tells of failures tells of a silent robot


class TraceError(ValueError):
    """A trace that cannot be read: says the line and what is wrong."""


class _TraceRobot(msgspec.Struct, frozen=True):
    id: str | int
    x: int
    y: int
    load: str | int | None = None
    to: Cell | None = None


class _TraceFailure(msgspec.Struct, frozen=True):
    robot: str = ''


class _TraceLine(msgspec.Struct, frozen=True):
    step: int
    robots: tuple[_TraceRobot, ...]
    removed: tuple[str, ...] = ()
    failures: tuple[_TraceFailure, ...] | None = None
    events: tuple[msgspec.Raw, ...] | None = None


def validate_trace(
    rows: Sequence[str],
    tasks: Sequence[tuple[int, Cell, Cell]] | None,
    lines: Iterable[str],
    *,
    crashed: Mapping[str, int] | None = None,
    unreachable: Collection[int] = (),
) -> tuple[Violation, ...]:
    """Judge a trace of unit steps: `{"step", "robots": [{"id", "x", "y", "load"}]}` a line.

    A load is taken, and given, in the row of the step in which the robot stands on its cell.

    Args:
        rows: The map.
        tasks: Release step, pick-up and delivery of each task; `load` is the number of a task in
            this order. None: only moves are judged.
        lines: The trace, a JSON text a line.
        crashed: The step in which a robot crashed: from then it stands, and a robot next to it
            may take its load.
        unreachable: Tasks that need not be done.

    Raises:
        TraceError: A line is not what it should be.
    """
    crashed = {str(robot): step for robot, step in (crashed or {}).items()}
    referee = Referee(Rules(tuple(rows), walls=WALLS))
    jobs = {
        str(number): Job(str(number), frozenset([pickup]), delivery, release)
        for number, (release, pickup, delivery) in enumerate(tasks or ())
    }
    for job in jobs.values():
        referee.loads.know(job)
    found: list[Violation] = []
    stood: dict[str, Cell] = {}
    step = -1
    sight = _Sight()
    for line in _trace_lines(lines):
        if sight.last is not None and line.step <= step:
            raise TraceError(f'step {line.step} comes after step {step}')
        if sight.last is not None and line.step > step + 1:
            found.append(Violation(line.step, 'missing', f'no step {step + 1} in the trace'))
        frame = _trace_frame(line, crashed, judge_loads=tasks is not None)
        if sight.last is None:
            found += _judge_start(referee, frame)
        step = line.step
        sight.note(line)
        found += _judge_crashed(line, crashed, stood)
        for seen in frame.robots:
            if seen.faulty and seen.loads and seen.loads[0] in jobs:
                referee.loads.know(jobs[seen.loads[0]]._replace(stranded=True))
        found += referee.check(frame)
    if sight.last is None:
        raise TraceError('there is no step in it')
    found += sight.vanished()
    found += [
        Violation(step, 'undone', f'task {number} was not delivered')
        for number in range(len(tasks or ()))
        if number not in unreachable and not referee.loads.was_delivered(str(number))
    ]
    return tuple(found)


class _Sight:
    """Which robots a trace shows: each to the end, or it says why not."""

    def __init__(self) -> None:
        self.last: _TraceLine | None = None
        self._seen: dict[str, int] = {}  # by robot: the last step that shows it
        self._failed: set[str] = set()
        self._has_log = False

    def note(self, line: _TraceLine) -> None:
        """Take the next line."""
        self.last = line
        self._seen.update((str(robot.id), line.step) for robot in line.robots)
        self._failed.update(failure.robot for failure in line.failures or ())
        self._has_log = self._has_log or (line.failures or line.events) is not None

    def vanished(self) -> list[Violation]:
        """The robots that are not there at the end, and neither failed nor were taken away."""
        assert self.last is not None
        end, excused = self.last.step, {*self.last.removed, *self._failed}
        patience = SILENT if self._has_log else 0
        return [
            Violation(step, 'vanished', f'{robot} is not seen after step {step}', (robot,))
            for robot, step in self._seen.items()
            if step + patience < end and robot not in excused
        ]


def _judge_start(referee: Referee, frame: Frame) -> tuple[Violation, ...]:
    """Where the robots are at first; their loads they take in that step."""
    empty = tuple([seen._replace(loads=()) for seen in frame.robots])
    found = referee.check(frame._replace(step=frame.step - 1, robots=empty))
    # Those that are in the same cell still are so in the step itself.
    return tuple(replace(one, step=frame.step) for one in found if one.rule != 'collision')


def _trace_lines(lines: Iterable[str]) -> Iterable[_TraceLine]:
    decoder = msgspec.json.Decoder(_TraceLine, strict=False)
    for number, text in enumerate(lines, 1):
        if not text.strip():
            continue
        try:
            yield decoder.decode(text)
        except msgspec.DecodeError as error:
            raise TraceError(f'line {number}: {error}') from None


def _judge_crashed(
    line: _TraceLine, crashed: Mapping[str, int], stood: dict[str, Cell]
) -> list[Violation]:
    found = []
    for robot in line.robots:
        name = str(robot.id)
        if name in crashed and line.step >= crashed[name]:
            cell = stood.setdefault(name, (robot.x, robot.y))
            if cell != (robot.x, robot.y):
                text = f'{name} crashed at {cell}, and drives'
                found.append(Violation(line.step, 'crashed', text, (name,)))
    return found


def _trace_frame(line: _TraceLine, crashed: Mapping[str, int], *, judge_loads: bool) -> Frame:
    return Frame(
        line.step,
        float(line.step),
        tuple(
            [
                Seen(
                    robot=str(robot.id),
                    cells=((robot.x, robot.y), robot.to) if robot.to else ((robot.x, robot.y),),
                    loads=(str(robot.load),) if judge_loads and robot.load is not None else (),
                    faulty=str(robot.id) in crashed and line.step >= crashed[str(robot.id)],
                )
                for robot in line.robots
            ]
        ),
        frozenset(line.removed),
    )
