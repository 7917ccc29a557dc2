"""How long a test may take: none can hang."""

from pathlib import Path
from typing import Final

import pytest
from patience import patient

TESTS: Final = Path(__file__).parent

# Seconds for the body of a test that names no limit of its own (pytest.mark.timeout).
LIMITS_S: Final = {'unit': 60, 'integration': 150, 'system': 300, 'faults': 300}


def tier(item: pytest.Item) -> str:
    """The folder of `tests` that a test lies in."""
    return item.path.relative_to(TESTS).parts[0]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give each test its limit; fixtures have limits of their own, in what they wait for."""
    for item in items:
        own = item.get_closest_marker('timeout')
        limit_s = own.args[0] if own else LIMITS_S[tier(item)]
        item.add_marker(pytest.mark.timeout(patient(limit_s)), append=False)
