"""How loads move on the floor: where each of them is, and by which rules it came there."""

from typing import Final, Literal, NamedTuple

from ros2_kafka_warehouse.domain.referee_moves import ANYTHING, Change, Moves, Say, stood
from ros2_kafka_warehouse.domain.rules import Frame, Job, Seen, distance, is_near
from ros2_kafka_warehouse.messages.message import Cell

MEMORY: Final = 100_000  # delivered loads that are remembered
PATIENCE: Final = 200  # steps in which the task of a load has to become known
OVERLAP: Final = 20  # steps after a change in which what was ordered before may still be taken


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


class Loads:
    """Where the loads are, and how they got there.

    Args:
        moves: Where the robots are that carry them.
        say: Is told what broke a rule.
    """

    def __init__(self, moves: Moves, say: Say) -> None:
        self._moves = moves
        self._say = say
        self._step = 0  # the newest that was judged
        self._places: dict[str, _Place] = {}
        self._jobs: dict[str, Job] = {}
        self._former: dict[str, tuple[int, Job]] = {}  # by task: until when it counts, too
        self._delivered = 0
        self._dropped: dict[str, int] = {}  # by load: the step in which it was seen delivered
        self._undone: set[str] = set()  # were delivered, by a floor that has started again since
        self._grips: dict[str, list[_Grip]] = {}
        self._lying: set[str] = set()  # loads on the floor

    def know(self, job: Job) -> None:
        """Take a job that is new or has changed."""
        known = self._jobs.get(job.task_id, job)
        if (known.sources, known.weight_kg) != (job.sources, job.weight_kg):
            self._former[job.task_id] = (self._step + OVERLAP, known)
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

    # Frames

    def begin(self) -> None:
        """Take a frame that does not follow the last one; then each of its robots."""
        self._dropped.clear()
        for load, place in self._places.items():
            if place.kind == 'robot' and place.robot not in self._moves.silent:
                self._places[load] = _UNKNOWN

    def begin_with(self, seen: Seen, step: int) -> None:
        """Take what a robot carries."""
        self._judge_number(seen, step)
        for load in seen.loads:
            place = self._places.get(load, _UNKNOWN)
            if place.kind == 'robot' and place.robot not in self._moves.silent:
                text = f'{load} is on two robots'
                self._say(step, 'doubled', text, seen.robot, place.robot)
            if place is _DELIVERED:
                self._delivered -= 1
                self._undone.add(load)
            self._places[load] = _Place('robot', seen.robot)

    def follow(self, changes: list[Change], frame: Frame) -> None:
        """Judge what was taken and set down in a frame that follows the last one."""
        lost: list[tuple[str, Change]] = []
        gained: list[tuple[str, Change]] = []
        for change in changes:
            had = change.before.loads if change.before else ()
            has = change.seen.loads
            if had != has:
                lost += [(load, change) for load in had if load not in has]
                gained += [(load, change) for load in has if load not in had]
                self._judge_number(change.seen, frame.step)
        for load, change in gained:
            given = any(load == other for other, _ in lost)
            seen = change.seen._replace(cells=stood(change))
            self._judge_gain(seen, load, frame, given=given)
            self._lying.discard(load)
            self._places[load] = _Place('robot', seen.robot)
        for load, change in lost:
            place = self._places.get(load, _UNKNOWN)
            if place.kind == 'robot' and place.robot == change.seen.robot:
                self._judge_loss(load, change, frame)

    def end(self, step: int) -> None:
        """Take a step as judged."""
        self._step = step
        if self._grips and step % PATIENCE == 0:
            self._lose_patience(step)

    def note_out_of_sight(self) -> None:
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
        return any(
            is_near(cells, self._moves.tracks[robot].seen.cells, 2) for robot in self._moves.silent
        )

    # Rules

    def _judge_number(self, seen: Seen, step: int) -> None:
        if len(seen.loads) > 1:
            self._say(step, 'loads', f'{seen.robot} carries {", ".join(seen.loads)}', seen.robot)

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
        elif place.kind == 'floor' and not is_near(seen.cells, place.cells, 1):
            text = f'{seen.robot} at {seen.cells[0]} took {load}, which is at {place.cells[0]}'
            self._say(frame.step, 'source', text, seen.robot)
        if job is not None:
            self._judge_limits(job, grip)

    def _judge_hand_over(
        self, seen: Seen, load: str, giver: str, frame: Frame, *, given: bool
    ) -> None:
        step = frame.step
        heard = any(other.robot == giver for other in frame.robots)
        silent = giver in self._moves.silent or not heard
        if not silent and not given:
            self._say(step, 'doubled', f'{load} is on two robots', seen.robot, giver)
            return
        there = self._moves.tracks[giver].seen.cells
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
        most = 1 + is_silent + (taker.robot in self._moves.silent)
        if is_near(taker.cells, there, most):
            return True
        between = (
            self._moves.tracks[robot].seen.cells for robot in self._moves.silent if is_silent
        )
        return any(
            is_near(taker.cells, cells, 2) and is_near(cells, there, 2) for cells in between
        )

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
        places = (self._moves.tracks[robot].seen.cells for robot in self._moves.silent)
        return any(
            job.sources.intersection(cells) and is_near(grip.cells, cells, 1) for cells in places
        )

    def _judge_limits(self, job: Job, grip: _Grip) -> None:
        limits = self._moves.rules.types.get(grip.type, ANYTHING)
        jobs = self._ordered(job, grip.step)
        if all(one.weight_kg > limits.max_load_kg for one in jobs):
            most = f'{grip.robot} may carry {limits.max_load_kg:g}'
            text = f'{job.task_id} weighs {job.weight_kg:g} kg, {most}'
            self._say(grip.step, 'weight', text, grip.robot)
        sizes = limits.sizes
        if sizes is not None and all(one.size and one.size not in sizes for one in jobs):
            text = f'{job.task_id} is {job.size}, which {grip.robot} cannot carry'
            self._say(grip.step, 'size', text, grip.robot)

    def _judge_loss(self, load: str, change: Change, frame: Frame) -> None:
        _, before, seen = change
        assert before is not None
        job = self._jobs.get(load)
        cells = stood(change)
        if seen.robot in self._moves.silent:
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

    def _judge_loss_unseen(self, load: str, change: Change, step: int) -> None:
        """While nobody heard of it, it may have driven on to its delivery, or been emptied."""
        track, before, seen = change
        assert before is not None
        job = self._jobs.get(load)
        reach = (step - track.stood) // track.limits.steps_per_cell
        near = job is None or distance(before.cells[0], job.delivery) <= reach
        if load in seen.dropped and near:
            self._deliver(load)
        else:
            self._lay(load, before.cells + seen.cells)

    def _may_be_taken(self, job: Job | None, cells: tuple[Cell, ...], frame: Frame) -> bool:
        """Whether a robot that fell silent just now or before may have taken a load."""
        if job is None or not job.stranded or len(frame.robots) == len(self._moves.tracks):
            return False
        heard = {seen.robot for seen in frame.robots}
        return any(
            is_near(cells, track.seen.cells, 2)
            for robot, track in self._moves.tracks.items()
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
