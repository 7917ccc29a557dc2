"""Who looks at the page: so many in all, and apart those with the token."""

from collections import Counter
from collections.abc import Sequence
from typing import Final

MOST: Final = 50
MOST_WITH_TOKEN: Final = 10


class Viewer:
    """One that looks.

    Args:
        network: Where it is from.
        has_token: Whether it has shown the token.
    """

    def __init__(self, network: str, *, has_token: bool) -> None:
        self.network = network
        self.has_token = has_token
        self.is_let_go = False


class Viewers:
    """All that look, in the order in which they have come."""

    def __init__(self) -> None:
        self._all: list[Viewer] = []

    def __len__(self) -> int:
        return len(self._all)

    def enter(self, viewer: Viewer) -> bool:
        """Let one in; where that is too many, one of its kind goes, which is never this one.

        Returns:
            Whether another had to go.
        """
        self._all.append(viewer)
        alike = [it for it in self._all if it.has_token == viewer.has_token]
        is_full = len(alike) > (MOST_WITH_TOKEN if viewer.has_token else MOST)
        if is_full:
            oldest = _oldest_of_most(alike, viewer)
            oldest.is_let_go = True
            self._all.remove(oldest)
        return is_full

    def leave(self, viewer: Viewer) -> None:
        """Take one out, if it is still there."""
        if not viewer.is_let_go:
            self._all.remove(viewer)


def _oldest_of_most(alike: Sequence[Viewer], newest: Viewer) -> Viewer:
    """The first to come of the network that has most: so nobody takes the places of others."""
    of_each = Counter(it.network for it in alike)
    return max((it for it in alike if it is not newest), key=lambda it: of_each[it.network])
