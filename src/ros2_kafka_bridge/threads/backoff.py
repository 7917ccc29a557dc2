"""How long to wait before something that has failed is tried again."""

from typing import Final, NamedTuple

_FIRST_S: Final = 1.0
_LONGEST_S: Final = 10.0
_WELL_S: Final = 30.0


class Backoff(NamedTuple):
    """The wait before the next try: it doubles up to ten seconds.

    Args:
        wait_s: How long that wait is; 0 while nothing has failed.
    """

    wait_s: float = 0.0

    def after(self, ran_s: float = 0.0) -> 'Backoff':
        """The wait after one more failure.

        Args:
            ran_s: How long it ran this time, 0 where it never did; what ran for long was well,
                and begins anew.
        """
        if ran_s > _WELL_S:
            return Backoff(_FIRST_S)
        return Backoff(min(_LONGEST_S, max(_FIRST_S, 2 * self.wait_s)))
