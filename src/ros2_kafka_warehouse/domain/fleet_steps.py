"""Where the simulated fleet is in time, and what is new since others have seen it."""


class Steps:
    """The steps of a fleet.

    Attributes:
        now: The newest.
        shown: The newest that others have seen.
        changed: The one that first shows the newest change of the floor.
        is_kept_old: What is kept of the fleet has changed since it was written down.
    """

    def __init__(self) -> None:
        self.now = 0
        self.shown = 0
        self.changed = 0
        self.is_kept_old = False

    def note_change(self) -> None:
        """Note that what was planned on the states so far is void."""
        self.changed = self.shown + 1
        self.is_kept_old = True
