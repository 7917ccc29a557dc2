"""A peer that goes as far as the test lets it: what is to be in mid-stream is so for certain."""

from pathlib import Path


class Leave:
    """How many messages a publisher may publish, or a subscriber take (`--leave FILE`).

    Args:
        place: Where its file goes.
    """

    def __init__(self, place: Path) -> None:
        place.mkdir(parents=True, exist_ok=True)
        self._file = place / 'leave'
        self.options = ('--leave', str(self._file))
        self.up_to(0)

    def up_to(self, count: int) -> None:
        """Let it go on until it has done so many."""
        new = self._file.with_suffix('.new')
        new.write_text(str(count))
        new.replace(self._file)
