"""How robots move on the floor: where each of them is, and by which rules it came there."""

from collections.abc import Callable
from typing import Final, NamedTuple

from ros2_kafka_warehouse.domain.rules import Frame, Limits, Rules, Seen, distance
from ros2_kafka_warehouse.messages.message import Cell

Say = Callable[..., None]
"""Notes a violation: its step, rule and description, and the robots that broke it."""

ANYTHING: Final = Limits()


class Track:
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


class Change(NamedTuple):
    """A robot that is not as it was in the frame before; `before` None: it is new."""

    track: Track
    before: Seen | None
    seen: Seen


def _is_quick(track: Track, step: int) -> bool:
    """Whether a robot had no time for three cells, the shortest way around to one next to it."""
    return step - track.stood < 3 * track.limits.steps_per_cell


def _is_back(robot: str, changes: list[Change]) -> bool:
    return any(change.seen.robot == robot for change in changes)


def stood(change: Change) -> tuple[Cell, ...]:
    """Where a robot was when it picked or dropped in a step."""
    if change.before is not None and change.track.limits.acts_at_once:
        return change.before.cells
    return change.seen.cells


class Moves:
    """Where the robots are, and how they got there.

    Args:
        rules: The map, the types of robots, and their homes.
        say: Is told what broke a rule.

    Attributes:
        tracks: What is remembered of each robot.
        silent: The robots that the newest frame does not show.
    """

    def __init__(self, rules: Rules, say: Say) -> None:
        self.rules = rules
        self.tracks: dict[str, Track] = {}
        self.silent: set[str] = set()
        self._say = say
        self._free = {
            (x, y)
            for y, row in enumerate(rules.rows)
            for x, mark in enumerate(row)
            if mark not in rules.walls
        }
        self._held: dict[Cell, str] = {}
        self._pallets: frozenset[Cell] = frozenset()

    def begin(self, frame: Frame) -> None:
        """Take a frame that does not follow the last one; then each of its robots."""
        self.silent = self.tracks.keys() - {seen.robot for seen in frame.robots}
        self._held.clear()
        self._pallets = frame.pallets

    def begin_with(self, seen: Seen, step: int, *, is_later: bool) -> None:
        """Take where a robot is; how it came there is judged if the frame `is_later`."""
        track = self.tracks.get(seen.robot)
        if track is not None and is_later:
            self._judge_move(track, seen, step)
        self._appear(seen, step)
        for cell in seen.cells:
            self._hold(seen, cell, step)

    def follow(self, frame: Frame) -> list[Change]:
        """Judge the moves of a frame that follows the last one; returns who has changed."""
        changes: list[Change] = []
        step = frame.step
        for seen in frame.robots:
            track = self.tracks.get(seen.robot)
            if track is None:
                changes.append(Change(self._appear(seen, step), None, seen))
            elif track.seen is seen and track.step == step - 1:
                track.step = step
                if len(seen.cells) == 1:
                    track.stood = step
            else:
                if seen.robot in self.silent and seen.robot in frame.removed:
                    track.removed = True
                changes.append(Change(track, track.seen, seen))
        for change in changes:
            if change.before is not None and change.before.cells != change.seen.cells:
                self._judge_move(change.track, change.seen, step)
                self._judge_entries(change, changes, frame)
        return changes

    def move(self, changes: list[Change], frame: Frame) -> None:
        """Take the frame as the newest, once all of it was judged."""
        step = frame.step
        held = self._held
        for _, before, seen in changes:
            for cell in before.cells if before else ():
                if held.get(cell) == seen.robot:
                    del held[cell]
        self.silent.difference_update([change.seen.robot for change in changes])
        for track, _, seen in changes:
            for cell in seen.cells:
                self._hold(seen, cell, step)
            if len(seen.cells) == 1 or seen.cells[0] != track.seen.cells[0]:
                track.stood = step
            track.seen = seen
            track.step = step
            track.removed = False
        self._note_silent(frame)
        self._pallets = frame.pallets

    def _appear(self, seen: Seen, step: int) -> Track:
        limits = self.rules.types.get(seen.type, ANYTHING)
        track = self.tracks[seen.robot] = Track(seen, step, limits)
        for cell in seen.cells:
            self._judge_ground(seen, cell, step)
        self._judge_way(seen, step)
        return track

    def _note_silent(self, frame: Frame) -> None:
        if len(frame.robots) == len(self.tracks):
            return
        self.silent = self.tracks.keys() - {seen.robot for seen in frame.robots}
        for robot in self.silent & frame.removed:
            track = self.tracks[robot]
            if not track.removed:
                track.removed = True
                for cell in track.seen.cells:
                    if self._held.get(cell) == robot:
                        del self._held[cell]

    def _hold(self, seen: Seen, cell: Cell, step: int) -> None:
        other = self._held.get(cell)
        if other is not None and other != seen.robot and other not in self.silent:
            self._say(step, 'collision', f'both hold {cell}', seen.robot, other)
        self._held[cell] = seen.robot

    def _judge_ground(self, seen: Seen, cell: Cell, step: int) -> None:
        if cell not in self._free:
            self._say(step, 'wall', f'{seen.robot} is on {cell}, where a wall is', seen.robot)

    def _judge_way(self, seen: Seen, step: int) -> None:
        if len(seen.cells) == 2 and distance(*seen.cells) != 1:
            self._say(step, 'teleport', f'{seen.robot} drives {seen.cells}', seen.robot)

    def _judge_move(self, track: Track, seen: Seen, step: int) -> None:
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
            if distance(start, end) != 1 or end != aimed[0]:
                text = f'{seen.robot} went from {before.cells} to {end} in one step'
                self._say(step, 'teleport', text, seen.robot)
                return
        steps = step - track.stood
        if distance(start, end) * track.limits.steps_per_cell > steps:
            text = f'{seen.robot} went from {start} to {end} in {steps} steps'
            self._say(step, 'speed', text, seen.robot)
        # What it reports is rounded: the last percent may carry it to one more cell.
        empty = before.charge <= 0 and seen.charge <= 0
        if seen.charge < 0 or (empty and track.flat):
            self._say(step, 'battery', f'{seen.robot} drives with an empty battery', seen.robot)
        track.flat = empty

    def _judge_entries(self, change: Change, changes: list[Change], frame: Frame) -> None:
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
            if other in self.silent and not _is_back(other, changes):
                text = f'{seen.robot} entered {cell}, where the silent {other} was last seen'
                self._say(frame.step, 'silent', text, seen.robot, other)
            else:
                self._judge_following(change, other, changes, frame.step)

    def _judge_following(
        self, change: Change, other: str, changes: list[Change], step: int
    ) -> None:
        follower, before, seen = change
        assert before is not None
        for track, its_before, its_now in changes:
            if its_now.robot != other or its_before is None:
                continue
            if step != track.step + 1 or step != follower.step + 1:
                self._judge_unseen_swap(change, Change(track, its_before, its_now), step)
            elif before.cells[0] in its_now.cells and its_before.cells != its_now.cells:
                if seen.robot < other:
                    text = f'at {before.cells[0]} and {its_before.cells[0]}'
                    self._say(step, 'swap', text, seen.robot, other)
            elif any(len(one.cells) > 1 for one in (before, seen, its_before, its_now)):
                text = f'{seen.robot} entered {seen.cells[-1]} before {other} had left it'
                self._say(step, 'held', text, seen.robot, other)

    def _judge_unseen_swap(self, one: Change, other: Change, step: int) -> None:
        """Two of which one was silent and that changed places, in less time than a way around."""
        tracks = one.track, other.track
        if any(track.removed or not _is_quick(track, step) for track in tracks):
            return
        came, went = (change.before.cells[0] for change in (one, other) if change.before)
        is_swap = came in other.seen.cells and went in one.seen.cells
        if is_swap and one.seen.robot < other.seen.robot:
            text = f'at {came} and {went}, out of sight'
            self._say(step, 'swap', text, one.seen.robot, other.seen.robot)
