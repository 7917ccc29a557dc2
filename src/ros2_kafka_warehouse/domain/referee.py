"""The referee: checks the floor frame by frame, the second opinion on everything that moved.

Written from the rules alone. It knows nothing of how ways are planned or tasks are given out, and
shares no code with the modules that do.
"""

from ros2_kafka_warehouse.domain.referee_loads import Loads
from ros2_kafka_warehouse.domain.referee_moves import Moves
from ros2_kafka_warehouse.domain.rules import Frame, Rules
from ros2_kafka_warehouse.messages.onlookers import Violation


class Referee:
    """Looks at one frame after the other, and says what broke a rule.

    The first frame is taken as it is, as is one that does not follow the last: the floor was
    started again, perhaps from a state that is a little older, or frames were lost. Then only
    the speed is judged.

    Attributes:
        loads: Where the loads are; to be told what is to become of them.
    """

    def __init__(self, rules: Rules) -> None:
        self._moves = Moves(rules, self._say)
        self.loads = Loads(self._moves, self._say)
        self._step: int | None = None
        self._found: list[Violation] = []

    def change(self, rules: Rules) -> None:
        """Take what the types of robots can do now; the map stays."""
        self._moves.rules = rules

    def check(self, frame: Frame) -> tuple[Violation, ...]:
        """Judge the step that ended in this frame; also what became known since the last one."""
        if self._step is not None and frame.step == self._step + 1:
            self._follow(frame)
        else:
            self._begin(frame)
        self._step = frame.step
        self.loads.end(frame.step)
        found, self._found = tuple(self._found), []
        return found

    def _begin(self, frame: Frame) -> None:
        is_later = self._step is not None and frame.step > self._step
        self._moves.begin(frame)
        self.loads.begin()
        for seen in frame.robots:
            self._moves.begin_with(seen, frame.step, is_later=is_later)
            self.loads.begin_with(seen, frame.step)

    def _follow(self, frame: Frame) -> None:
        changes = self._moves.follow(frame)
        self.loads.follow(changes, frame)
        self._moves.move(changes, frame)
        if self._moves.silent:
            self.loads.note_out_of_sight()

    def _say(self, step: int, rule: str, description: str, *robots: str) -> None:
        self._found.append(Violation(step, rule, description, robots))
