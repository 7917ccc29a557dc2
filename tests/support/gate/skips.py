"""Where CI=true a skipped test is a failed one: what is not run proves nothing.

The few that may be skipped there need what no project can install by itself.
"""

from collections.abc import Generator
from typing import Final

import pytest
from support.patience import IS_CI

ALLOWED: Final = (
    'no network of its own can be made here',  # needs root and network namespaces
    'a small disk cannot be mounted here',  # needs root and mount
    'needs IPv6',  # of the kernel
    'no Python 3.',  # another version than that of the run
)


@pytest.hookimpl(wrapper=True, trylast=True)  # before others look at it
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Turn a skip into a failure that says why it was one."""
    report = yield
    if report.skipped and not hasattr(report, 'wasxfail'):
        _refuse(report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """The same for a whole file."""
    report = yield
    if report.skipped:
        _refuse(report)
    return report


def _refuse(report: pytest.TestReport | pytest.CollectReport) -> None:
    reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
    if IS_CI and not any(allowed in reason for allowed in ALLOWED):
        report.outcome = 'failed'
        report.longrepr = f'{reason}: with CI=true a skip is a failure (tests/support/gate)'
