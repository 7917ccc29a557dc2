"""What is said to users: compared by the words that they need, not by all of them."""

import re
from collections.abc import Sequence


def fits(said: str, expected: str) -> bool:
    """Whether a sentence has these words; `...` stands for any others."""
    words = re.split(r'\s*\.\.\.\s*', expected.strip())
    return re.fullmatch('.*'.join(map(re.escape, words)), said) is not None


def misfits(said: Sequence[str], expected: Sequence[str]) -> list[tuple[str, str]]:
    """The sentences that do not fit, each beside what was expected."""
    assert len(said) == len(expected), said
    return [both for both in zip(said, expected, strict=True) if not fits(*both)]


OFFERED = 'durability: volatile is offered, transient_local is asked for'


def row(out: str, topic: str) -> str:
    """The line of a topic, one blank between its words."""
    [found] = [line for line in out.splitlines() if line.split()[:1] == [topic]]
    return ' '.join(found.split())
