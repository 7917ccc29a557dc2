"""How long a test may take: none can hang."""

import signal
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Final

import pytest
from support.patience import patient

TESTS: Final = Path(__file__).parents[2]

# Seconds for the body of a test that names no limit of its own (pytest.mark.timeout).
LIMITS_S: Final = {'unit': 60, 'integration': 150, 'system': 300, 'faults': 300}
FIXTURES_S: Final = 150.0  # for all that are made before a test, or end after it: at least
_own_s: Final = pytest.StashKey[float]()


def tier(item: pytest.Item) -> str:
    """The folder of `tests` that a test lies in."""
    return item.path.relative_to(TESTS).parts[0]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give the body of each test its limit."""
    for item in items:
        own = item.get_closest_marker('timeout')
        item.stash[_own_s] = own.args[0] if own else 0.0
        limit_s = item.stash[_own_s] or LIMITS_S[tier(item)]
        item.add_marker(pytest.mark.timeout(patient(limit_s)), append=False)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Generator[None]:
    """Limit the fixtures: pytest-timeout looks at bodies only, so that reruns have limits, too."""
    with _limited('fixtures that are made', item):
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Item) -> Generator[None]:
    """Limit their end."""
    with _limited('fixtures that end', item):
        return (yield)


@contextmanager
def _limited(what: str, item: pytest.Item) -> Iterator[None]:
    limit_s = patient(max(FIXTURES_S, item.stash[_own_s]))

    def fail(_number: int, _frame: FrameType | None) -> None:
        pytest.fail(f'Timeout (>{limit_s:.1f}s) of {what}')

    before = signal.signal(signal.SIGALRM, fail)
    signal.setitimer(signal.ITIMER_REAL, limit_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
