"""What `topics` prints."""

OFFERED = 'durability: volatile is offered, transient_local is asked for'


def row(out: str, topic: str) -> str:
    """The line of a topic, one blank between its words."""
    [found] = [line for line in out.splitlines() if line.split()[:1] == [topic]]
    return ' '.join(found.split())
