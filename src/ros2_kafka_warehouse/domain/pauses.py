"""Who is told to stand, until it may go on."""

from collections.abc import Mapping
from typing import Final

from ros2_kafka_warehouse.domain.casebook import Casebook
from ros2_kafka_warehouse.domain.evidence import Watch

PAUSE_AGAIN_S: Final = 3.0


class Pauses:
    """Has robots stand, and go on.

    Args:
        book: Knows who is told to stand, and who must.
        watches: What is known of each robot.
    """

    def __init__(self, book: Casebook, watches: Mapping[str, Watch]) -> None:
        self._book = book
        self._watches = watches
        self._asked: dict[str, tuple[bool, float]] = {}

    def tell(self, halted: bool, now_s: float) -> None:  # noqa: FBT001  # a state
        """Have those robots stand, and only those, that must; ask again who does not obey."""
        told = self._book.memory.paused_robots
        unsafe = {one.robot for one in self._book.memory.failures if 'safe_stop' in one.active}
        for name, watch in self._watches.items():
            if name in self._book.memory.removed or watch.missing_s is not None:
                continue
            stops = halted or name in unsafe
            if stops and name not in told:
                told.append(name)
                self._book.is_dirty = True
            if name not in told:
                continue
            if stops != watch.state.paused:
                wish, asked_s = self._asked.get(name, (not stops, 0.0))
                if wish != stops or now_s - asked_s >= PAUSE_AGAIN_S:
                    self._asked[name] = (stops, now_s)
                    self._book.act(name, 'startPause' if stops else 'stopPause')
            elif not stops:
                told.remove(name)
                self._book.is_dirty = True
