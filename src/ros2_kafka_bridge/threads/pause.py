"""How a route is told to pause."""


class Pause:
    """Asked for by an operator, from another thread; read by the thread of the route.

    A plain attribute, as in `Stop`.

    Args:
        asked: Whether to begin paused.
    """

    reason = 'paused by an operator'

    def __init__(self, *, asked: bool = False) -> None:
        self.asked = asked
