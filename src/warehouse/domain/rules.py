"""The rules of the floor, checked frame by frame: the second opinion on everything that moved.

Written from the rules alone. It knows nothing of how ways are planned or tasks are given out, and
shares no code with the modules that do. A frame is what the floor looked like at the end of a
step; what lies between two frames is judged by these rules:

- A robot is on free cells of the map, goes to one of the four neighbours, and takes at least the
  steps that its type needs for a cell. While it is between two cells it holds both.
- A cell is held by one robot. Two robots do not change places. A robot follows into the cell of
  another only if both make the whole way in the same step.
- A pallet is not driven through, nor the place of a robot that is not heard of.
- A robot with an empty battery does not drive.
- A robot carries one load, within the weight and the sizes of its type. A load comes from stock
  once, not before its release, by a robot that stands where it is; one that was given up with a
  robot is taken from where that stands, or from next to it. It ends at its delivery, once. In
  between it neither vanishes nor appears.

A robot that is missing in a frame is silent: it is somewhere near, and still holds its load.
"""

from collections.abc import Iterable, Mapping
from math import inf
from typing import Final, Literal, NamedTuple

from warehouse.messages import Violation

__all__ = ['Frame', 'Job', 'Limits', 'Referee', 'Rules', 'Seen']

Cell = tuple[int, int]

MEMORY: Final = 100_000  # delivered loads that are remembered
PATIENCE: Final = 200  # steps in which the task of a load has to become known
OVERLAP: Final = 20  # steps after a change in which what was ordered before may still be taken


class Limits(NamedTuple):
    """What a type of robot can do.

    Attributes:
        sizes: Of the loads that it can carry; None: any.
        acts_at_once: It picks or drops without standing still for it, and may have left the cell
            at the end of the step.
    """

    steps_per_cell: int = 1
    max_load_kg: float = inf
    sizes: frozenset[str] | None = None
    acts_at_once: bool = False


class Rules(NamedTuple):
    """What does not change: the map, the types of robots, where each robot is put on the floor."""

    rows: tuple[str, ...]
    types: Mapping[str, Limits] = {}
    homes: Mapping[str, Cell] = {}
    walls: str = '@'


class Job(NamedTuple):
    """What is to become of a load.

    Attributes:
        sources: Cells from which it comes out of stock.
        stranded: It was given up by the robot that had it, and may be taken from there.
    """

    task_id: str
    sources: frozenset[Cell]
    delivery: Cell
    released_s: float = -inf
    weight_kg: float = 0.0
    size: str = ''
    stranded: bool = False


class Seen(NamedTuple):
    """One robot in a frame.

    Attributes:
        cells: The one that it stands on, or the two that it is between: from, to.
        faulty: It reports an error, with which a load may have fallen.
        dropped: Tasks whose loads it says to have dropped of late.
    """

    robot: str
    cells: tuple[Cell, ...]
    loads: tuple[str, ...] = ()
    type: str = ''
    charge: float = 100.0
    faulty: bool = False
    dropped: frozenset[str] = frozenset()


class Frame(NamedTuple):
    """The floor at the end of a step.

    Attributes:
        removed: Robots that were carried off the floor.
        pallets: Cells on which something stands.
    """

    step: int
    time_s: float
    robots: tuple[Seen, ...]
    removed: frozenset[str] = frozenset()
    pallets: frozenset[Cell] = frozenset()


class _Track:
    """What is remembered of a robot between frames."""

    __slots__ = ('flat', 'limits', 'removed', 'seen', 'step', 'stood')

    def __init__(self, seen: Seen, step: int, limits: Limits) -> None:
        self.seen = seen
        self.step = step
        # Of one that is between two cells nobody knows how long it has driven.
        self.stood = step if len(seen.cells) == 1 else step - limits.steps_per_cell
        self.limits = limits
        self.removed = False
        self.flat = False  # has come to a cell with a battery that it called empty


class _Change(NamedTuple):
    """A robot that is not as it was in the frame before; `before` None: it is new."""

    track: _Track
    before: Seen | None
    seen: Seen


class _Place(NamedTuple):
    """Where a load is."""

    kind: Literal['robot', 'floor', 'delivered', 'unknown']
    robot: str = ''
    cells: tuple[Cell, ...] = ()


class _Grip(NamedTuple):
    """A load that was taken or set down before its task was known."""

    step: int
    time_s: float
    robot: str
    cells: tuple[Cell, ...]
    type: str
    taken: bool


_DELIVERED: Final = _Place('delivered')
_UNKNOWN: Final = _Place('unknown')
_ANYTHING: Final = Limits()


def _distance(one: Cell, other: Cell) -> int:
    return abs(one[0] - other[0]) + abs(one[1] - other[1])


def _near(cells: Iterable[Cell], others: Iterable[Cell], most: int) -> bool:
    others = tuple(others)
    return any(_distance(one, other) <= most for one in cells for other in others)


def _is_quick(track: _Track, step: int) -> bool:
    """Whether a robot had no time for three cells, the shortest way around to one next to it."""
    return step - track.stood < 3 * track.limits.steps_per_cell


def _is_back(robot: str, changes: list[_Change]) -> bool:
    return any(change.seen.robot == robot for change in changes)


def _stood(change: _Change) -> tuple[Cell, ...]:
    """Where a robot was when it picked or dropped in a step."""
    if change.before is not None and change.track.limits.acts_at_once:
        return change.before.cells
    return change.seen.cells


class Referee:
    """Looks at one frame after the other, and says what broke a rule.

    The first frame is taken as it is, as is one that does not follow the last: the floor was
    started again, perhaps from a state that is a little older, or frames were lost. Then only
    the speed is judged.
    """

    def __init__(self, rules: Rules) -> None:
        self.rules = rules
        self._free = {
            (x, y)
            for y, row in enumerate(rules.rows)
            for x, mark in enumerate(row)
            if mark not in rules.walls
        }
        self._tracks: dict[str, _Track] = {}
        self._held: dict[Cell, str] = {}
        self._places: dict[str, _Place] = {}
        self._jobs: dict[str, Job] = {}
        self._former: dict[str, tuple[int, Job]] = {}  # by task: until when it counts, too
        self._delivered = 0
        self._dropped: dict[str, int] = {}  # by load: the step in which it was seen delivered
        self._undone: set[str] = set()  # were delivered, by a floor that has started again since
        self._grips: dict[str, list[_Grip]] = {}
        self._pallets: frozenset[Cell] = frozenset()
        self._silent: set[str] = set()
        self._lying: set[str] = set()  # loads on the floor
        self._step: int | None = None
        self._found: list[Violation] = []

    def know(self, job: Job) -> None:
        """Take a job that is new or has changed."""
        known = self._jobs.get(job.task_id, job)
        if (known.sources, known.weight_kg) != (job.sources, job.weight_kg):
            self._former[job.task_id] = ((self._step or 0) + OVERLAP, known)
        self._jobs[job.task_id] = job
        for grip in self._grips.pop(job.task_id, ()):
            if grip.taken:
                self._judge_stock(job, grip)
                self._judge_limits(job, grip)
            else:
                self._judge_delivery(job, grip)

    def forget(self, task_id: str) -> None:
        """Drop a job that is over."""
        self._jobs.pop(task_id, None)
        self._former.pop(task_id, None)
        self._dropped.pop(task_id, None)
        self._undone.discard(task_id)

    def excuse(self, task_id: str) -> None:
        """Ask nothing about where a load comes from: it was on its way before the first frame."""
        self._grips.pop(task_id, None)
        if task_id not in self._places:
            self._places[task_id] = _UNKNOWN

    def take_as_delivered(self, task_id: str) -> None:
        """Take for granted that a load was delivered before the first frame."""
        if self._places.get(task_id, _UNKNOWN) is _UNKNOWN:
            self._deliver(task_id)

    def was_delivered(self, task_id: str) -> bool | None:
        """Whether a load is at its delivery; None: nobody can know."""
        place = self._places.get(task_id)
        if place is _DELIVERED:
            return True
        return None if place is _UNKNOWN or task_id in self._undone else False

    def dropped_step(self, task_id: str) -> int | None:
        """The step in which a robot that was heard said that it delivered a load; None: none."""
        return self._dropped.get(task_id)

    def check(self, frame: Frame) -> tuple[Violation, ...]:
        """Judge the step that ended in this frame; also what became known since the last one."""
        if self._step is not None and frame.step == self._step + 1:
            self._follow(frame)
        else:
            self._begin(frame)
        self._step = frame.step
        if self._grips and frame.step % PATIENCE == 0:
            self._lose_patience(frame.step)
        if not self._found:
            return ()
        found, self._found = tuple(self._found), []
        return found

    # Frames

    def _begin(self, frame: Frame) -> None:
        present = {seen.robot for seen in frame.robots}
        self._silent = self._tracks.keys() - present
        self._dropped.clear()
        for load, place in self._places.items():
            if place.kind == 'robot' and place.robot not in self._silent:
                self._places[load] = _UNKNOWN
        self._held.clear()
        self._pallets = frame.pallets
        for seen in frame.robots:
            track = self._tracks.get(seen.robot)
            if track is not None and self._step is not None and frame.step > self._step:
                self._judge_move(track, seen, frame.step)
            self._appear(seen, frame.step)
            for cell in seen.cells:
                self._hold(seen, cell, frame.step)
            self._judge_number(seen, frame.step)
            for load in seen.loads:
                place = self._places.get(load, _UNKNOWN)
                if place.kind == 'robot' and place.robot not in self._silent:
                    text = f'{load} is on two robots'
                    self._say(frame.step, 'doubled', text, seen.robot, place.robot)
                if place is _DELIVERED:
                    self._delivered -= 1
                    self._undone.add(load)
                self._places[load] = _Place('robot', seen.robot)

    def _follow(self, frame: Frame) -> None:
        changes: list[_Change] = []
        step = frame.step
        for seen in frame.robots:
            track = self._tracks.get(seen.robot)
            if track is None:
                changes.append(_Change(self._appear(seen, step), None, seen))
            elif track.seen is seen and track.step == step - 1:
                track.step = step
                if len(seen.cells) == 1:
                    track.stood = step
            else:
                if seen.robot in self._silent and seen.robot in frame.removed:
                    track.removed = True
                changes.append(_Change(track, track.seen, seen))
        for change in changes:
            if change.before is not None and change.before.cells != change.seen.cells:
                self._judge_move(change.track, change.seen, step)
                self._judge_entries(change, changes, frame)
        self._judge_loads(changes, frame)
        self._move(changes, step)
        self._note_silent(frame)
        self._pallets = frame.pallets

    def _appear(self, seen: Seen, step: int) -> _Track:
        track = self._tracks[seen.robot] = _Track(seen, step, self._limits(seen))
        for cell in seen.cells:
            self._judge_ground(seen, cell, step)
        self._judge_way(seen, step)
        return track

    def _move(self, changes: list[_Change], step: int) -> None:
        held = self._held
        for _, before, seen in changes:
            for cell in before.cells if before else ():
                if held.get(cell) == seen.robot:
                    del held[cell]
        self._silent.difference_update([change.seen.robot for change in changes])
        for track, _, seen in changes:
            for cell in seen.cells:
                self._hold(seen, cell, step)
            if len(seen.cells) == 1 or seen.cells[0] != track.seen.cells[0]:
                track.stood = step
            track.seen = seen
            track.step = step
            track.removed = False

    def _note_silent(self, frame: Frame) -> None:
        if len(frame.robots) == len(self._tracks):
            return
        self._silent = self._tracks.keys() - {seen.robot for seen in frame.robots}
        self._note_out_of_sight()
        for robot in self._silent & frame.removed:
            track = self._tracks[robot]
            if not track.removed:
                track.removed = True
                for cell in track.seen.cells:
                    if self._held.get(cell) == robot:
                        del self._held[cell]

    def _note_out_of_sight(self) -> None:
        """A load on the floor near a silent robot may be on that, and then anywhere."""
        for load in tuple(self._lying):
            place = self._places.get(load, _UNKNOWN)
            if place.kind != 'floor':
                self._lying.discard(load)
            elif self._is_unseen(place.cells):
                self._lying.discard(load)
                self._places[load] = _UNKNOWN

    def _is_unseen(self, cells: tuple[Cell, ...]) -> bool:
        """Whether a silent robot can reach a load there: it may have driven on to a cell."""
        return any(_near(cells, self._tracks[robot].seen.cells, 2) for robot in self._silent)

    def _hold(self, seen: Seen, cell: Cell, step: int) -> None:
        other = self._held.get(cell)
        if other is not None and other != seen.robot and other not in self._silent:
            self._say(step, 'collision', f'both hold {cell}', seen.robot, other)
        self._held[cell] = seen.robot

    # Moves

    def _judge_ground(self, seen: Seen, cell: Cell, step: int) -> None:
        if cell not in self._free:
            self._say(step, 'wall', f'{seen.robot} is on {cell}, where a wall is', seen.robot)

    def _judge_way(self, seen: Seen, step: int) -> None:
        if len(seen.cells) == 2 and _distance(*seen.cells) != 1:
            self._say(step, 'teleport', f'{seen.robot} drives {seen.cells}', seen.robot)

    def _judge_move(self, track: _Track, seen: Seen, step: int) -> None:
        before = track.seen
        for cell in seen.cells:
            if cell not in before.cells:
                self._judge_ground(seen, cell, step)
        self._judge_way(seen, step)
        start, end = before.cells[0], seen.cells[0]
        home = self.rules.homes.get(seen.robot)
        if start == end or (track.removed and home in (None, end)):
            return
        if step == track.step + 1:
            aimed = before.cells[1:] or (end,)
            if _distance(start, end) != 1 or end != aimed[0]:
                text = f'{seen.robot} went from {before.cells} to {end} in one step'
                self._say(step, 'teleport', text, seen.robot)
                return
        steps = step - track.stood
        if _distance(start, end) * track.limits.steps_per_cell > steps:
            text = f'{seen.robot} went from {start} to {end} in {steps} steps'
            self._say(step, 'speed', text, seen.robot)
        # What it reports is rounded: the last percent may carry it to one more cell.
        empty = before.charge <= 0 and seen.charge <= 0
        if seen.charge < 0 or (empty and track.flat):
            self._say(step, 'battery', f'{seen.robot} drives with an empty battery', seen.robot)
        track.flat = empty

    def _judge_entries(self, change: _Change, changes: list[_Change], frame: Frame) -> None:
        _, before, seen = change
        assert before is not None
        for cell in seen.cells:
            if cell in before.cells:
                continue
            if cell in self._pallets and cell in frame.pallets:
                text = f'{seen.robot} entered {cell}, where a pallet stands'
                self._say(frame.step, 'pallet', text, seen.robot)
            other = self._held.get(cell)
            if other is None or other == seen.robot:
                continue
            if other in self._silent and not _is_back(other, changes):
                text = f'{seen.robot} entered {cell}, where the silent {other} was last seen'
                self._say(frame.step, 'silent', text, seen.robot, other)
            else:
                self._judge_following(change, other, changes, frame.step)

    def _judge_following(
        self, change: _Change, other: str, changes: list[_Change], step: int
    ) -> None:
        follower, before, seen = change
        assert before is not None
        for track, its_before, its_now in changes:
            if its_now.robot != other or its_before is None:
                continue
            if step != track.step + 1 or step != follower.step + 1:
                self._judge_unseen_swap(change, _Change(track, its_before, its_now), step)
            elif before.cells[0] in its_now.cells and its_before.cells != its_now.cells:
                if seen.robot < other:
                    text = f'at {before.cells[0]} and {its_before.cells[0]}'
                    self._say(step, 'swap', text, seen.robot, other)
            elif any(len(one.cells) > 1 for one in (before, seen, its_before, its_now)):
                text = f'{seen.robot} entered {seen.cells[-1]} before {other} had left it'
                self._say(step, 'held', text, seen.robot, other)

    def _judge_unseen_swap(self, one: _Change, other: _Change, step: int) -> None:
        """Two of which one was silent and that changed places, in less time than a way around."""
        tracks = one.track, other.track
        if any(track.removed or not _is_quick(track, step) for track in tracks):
            return
        came, went = (change.before.cells[0] for change in (one, other) if change.before)
        is_swap = came in other.seen.cells and went in one.seen.cells
        if is_swap and one.seen.robot < other.seen.robot:
            text = f'at {came} and {went}, out of sight'
            self._say(step, 'swap', text, one.seen.robot, other.seen.robot)

    # Loads

    def _judge_number(self, seen: Seen, step: int) -> None:
        if len(seen.loads) > 1:
            self._say(step, 'loads', f'{seen.robot} carries {", ".join(seen.loads)}', seen.robot)

    def _judge_loads(self, changes: list[_Change], frame: Frame) -> None:
        lost: list[tuple[str, _Change]] = []
        gained: list[tuple[str, _Change]] = []
        for change in changes:
            had = change.before.loads if change.before else ()
            has = change.seen.loads
            if had != has:
                lost += [(load, change) for load in had if load not in has]
                gained += [(load, change) for load in has if load not in had]
                self._judge_number(change.seen, frame.step)
        for load, change in gained:
            given = any(load == other for other, _ in lost)
            seen = change.seen._replace(cells=_stood(change))
            self._judge_gain(seen, load, frame, given=given)
            self._lying.discard(load)
            self._places[load] = _Place('robot', seen.robot)
        for load, change in lost:
            place = self._places.get(load, _UNKNOWN)
            if place.kind == 'robot' and place.robot == change.seen.robot:
                self._judge_loss(load, change, frame)

    def _judge_gain(self, seen: Seen, load: str, frame: Frame, *, given: bool) -> None:
        place = self._places.get(load)
        job = self._jobs.get(load)
        grip = _Grip(frame.step, frame.time_s, seen.robot, seen.cells, seen.type, taken=True)
        if place is None:
            if job is None:
                self._grips.setdefault(load, []).append(grip)
            else:
                self._judge_stock(job, grip)
        elif place is _DELIVERED:
            self._delivered -= 1
            self._dropped.pop(load, None)
            self._say(
                frame.step,
                'repeated',
                f'{load} was delivered, and is on {seen.robot} again',
                seen.robot,
            )
        elif place.kind == 'robot' and place.robot != seen.robot:
            self._judge_hand_over(seen, load, place.robot, frame, given=given)
        elif place.kind == 'floor' and not _near(seen.cells, place.cells, 1):
            text = f'{seen.robot} at {seen.cells[0]} took {load}, which is at {place.cells[0]}'
            self._say(frame.step, 'source', text, seen.robot)
        if job is not None:
            self._judge_limits(job, grip)

    def _judge_hand_over(
        self, seen: Seen, load: str, giver: str, frame: Frame, *, given: bool
    ) -> None:
        step = frame.step
        heard = any(other.robot == giver for other in frame.robots)
        silent = giver in self._silent or not heard
        if not silent and not given:
            self._say(step, 'doubled', f'{load} is on two robots', seen.robot, giver)
            return
        there = self._tracks[giver].seen.cells
        if not self._is_in_reach(seen, there, is_silent=silent):
            text = f'{seen.robot} at {seen.cells[0]} took {load} from {giver} at {there[0]}'
            self._say(step, 'source', text, seen.robot, giver)
        job = self._jobs.get(load)
        if job is not None and not job.stranded:
            text = f'{seen.robot} took {load}, which {giver} has not given up'
            self._say(step, 'taken', text, seen.robot, giver)

    def _is_in_reach(self, taker: Seen, there: tuple[Cell, ...], *, is_silent: bool) -> bool:
        """Whether a load can come from a robot to another, perhaps by way of silent ones."""
        # A robot that is silent may have driven on to the next cell.
        most = 1 + is_silent + (taker.robot in self._silent)
        if _near(taker.cells, there, most):
            return True
        between = (self._tracks[robot].seen.cells for robot in self._silent if is_silent)
        return any(_near(taker.cells, cells, 2) and _near(cells, there, 2) for cells in between)

    def _judge_stock(self, job: Job, grip: _Grip) -> None:
        jobs = self._ordered(job, grip.step)
        in_stock = any(grip.cells[0] in one.sources for one in jobs)
        at_stock = in_stock and len(grip.cells) == 1
        if not at_stock and not (job.stranded and self._was_picked_unseen(job, grip)):
            text = f'{grip.robot} took {job.task_id} from stock at {grip.cells[0]}'
            self._say(grip.step, 'source', text, grip.robot)
        if grip.time_s < job.released_s:
            text = f'{grip.robot} took {job.task_id} {job.released_s - grip.time_s:g} s too early'
            self._say(grip.step, 'release', text, grip.robot)

    def _ordered(self, job: Job, step: int) -> tuple[Job, ...]:
        """The job; for some steps also as it was before it changed: a pick may be on its way."""
        until, former = self._former.get(job.task_id, (-1, job))
        return (job, former) if step <= until else (job,)

    def _was_picked_unseen(self, job: Job, grip: _Grip) -> bool:
        """Whether a robot fell silent where the load comes from, next to who has it now."""
        places = (self._tracks[robot].seen.cells for robot in self._silent)
        return any(
            job.sources.intersection(cells) and _near(grip.cells, cells, 1) for cells in places
        )

    def _judge_limits(self, job: Job, grip: _Grip) -> None:
        limits = self.rules.types.get(grip.type, _ANYTHING)
        jobs = self._ordered(job, grip.step)
        if all(one.weight_kg > limits.max_load_kg for one in jobs):
            most = f'{grip.robot} may carry {limits.max_load_kg:g}'
            text = f'{job.task_id} weighs {job.weight_kg:g} kg, {most}'
            self._say(grip.step, 'weight', text, grip.robot)
        sizes = limits.sizes
        if sizes is not None and all(one.size and one.size not in sizes for one in jobs):
            text = f'{job.task_id} is {job.size}, which {grip.robot} cannot carry'
            self._say(grip.step, 'size', text, grip.robot)

    def _judge_loss(self, load: str, change: _Change, frame: Frame) -> None:
        _, before, seen = change
        assert before is not None
        job = self._jobs.get(load)
        cells = _stood(change)
        if seen.robot in self._silent:
            self._judge_loss_unseen(load, change, frame.step)
        elif job is None and not seen.faulty:
            self._grips.setdefault(load, []).append(
                _Grip(frame.step, frame.time_s, seen.robot, cells, seen.type, taken=False)
            )
            self._deliver(load)
        elif seen.faulty and load not in seen.dropped:
            self._lay(load, before.cells)
        elif load not in seen.dropped and self._may_be_taken(job, cells, frame):
            self._places[load] = _UNKNOWN
        elif job is not None and job.delivery in cells and len(cells) == 1:
            self._deliver(load)
            if load in seen.dropped:
                self._dropped[load] = frame.step
        else:
            self._lay(load, before.cells)
            self._say_not_delivered(load, seen.robot, cells, frame.step)

    def _judge_loss_unseen(self, load: str, change: _Change, step: int) -> None:
        """While nobody heard of it, it may have driven on to its delivery, or been emptied."""
        track, before, seen = change
        assert before is not None
        job = self._jobs.get(load)
        reach = (step - track.stood) // track.limits.steps_per_cell
        near = job is None or _distance(before.cells[0], job.delivery) <= reach
        if load in seen.dropped and near:
            self._deliver(load)
        else:
            self._lay(load, before.cells + seen.cells)

    def _may_be_taken(self, job: Job | None, cells: tuple[Cell, ...], frame: Frame) -> bool:
        """Whether a robot that fell silent just now or before may have taken a load."""
        if job is None or not job.stranded or len(frame.robots) == len(self._tracks):
            return False
        heard = {seen.robot for seen in frame.robots}
        return any(
            _near(cells, track.seen.cells, 2)
            for robot, track in self._tracks.items()
            if robot not in heard
        )

    def _lay(self, load: str, cells: tuple[Cell, ...]) -> None:
        self._places[load] = _Place('floor', cells=cells)
        self._lying.add(load)

    def _judge_delivery(self, job: Job, grip: _Grip) -> None:
        if grip.cells != (job.delivery,):
            self._say_not_delivered(job.task_id, grip.robot, grip.cells, grip.step)

    def _say_not_delivered(
        self, load: str, robot: str, cells: tuple[Cell, ...], step: int
    ) -> None:
        self._say(step, 'drop', f'{robot} lost {load} at {cells[0]}, not at its delivery', robot)

    def _deliver(self, load: str) -> None:
        self._places.pop(load, None)  # to the end: the oldest are forgotten first
        self._places[load] = _DELIVERED
        self._delivered += 1
        if self._delivered > 2 * MEMORY:
            ended = [name for name, place in self._places.items() if place is _DELIVERED]
            for name in ended[:-MEMORY]:
                del self._places[name]
            self._delivered = MEMORY

    def _lose_patience(self, step: int) -> None:
        for load, grips in list(self._grips.items()):
            if step - grips[0].step >= PATIENCE:
                del self._grips[load]
                text = f'{grips[0].robot} took or set down {load}, which nobody asked for'
                self._say(step, 'task', text, grips[0].robot)

    def _limits(self, seen: Seen) -> Limits:
        return self.rules.types.get(seen.type, _ANYTHING)

    def _say(self, step: int, rule: str, description: str, *robots: str) -> None:
        self._found.append(Violation(step, rule, description, robots))
