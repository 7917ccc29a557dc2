"""What belongs to a bridge at the broker, by name: its consumer groups, the topic of its locks.

A bridge has no dot in its name, so the first dot of a group tells whose it is.
"""


def reading_group(bridge: str, route: str) -> str:
    """The group that reads the topic of a route, unless the route says another."""
    return f'{bridge}.{route}'


def tail_group(bridge: str, route: str) -> str:
    """The group in whose name a route reads back what it has produced; it has no member."""
    return f'{bridge}.{route}.tail'


def lock_group(bridge: str, route: str) -> str:
    """The group whose member with the partition of the lock topic runs the route."""
    return f'{bridge}.{route}.lock'


def lock_topic(bridge: str) -> str:
    """The topic of all locks of the bridges of a name."""
    return f'{bridge}.lock'
