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
