"""A direction that holds nothing, for tests of a source of records alone."""


class Nobody:
    """Calls of a source while it is polled, which change nothing."""

    def revoked(self, partitions: frozenset[int]) -> None:
        pass

    def lost(self, partitions: frozenset[int]) -> None:
        pass
