"""A second chance for tests that start processes, and a loud word about each.

A race on a busy machine costs one rerun. A test that fails twice is red, and so is a run in which
more than `MOST` tests needed their second chance: then it is no race.
"""

import itertools
from typing import Final

import pytest
from support.gate.limits import tier

MOST: Final = 3


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let all but unit tests be run once more, with fixtures made anew."""
    for item in items:
        if tier(item) != 'unit':
            item.add_marker(pytest.mark.flaky(reruns=1))


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """Make a run red that needed too many reruns."""
    if exitstatus == pytest.ExitCode.OK and len(_run_again(session.config)) > MOST:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """Tell each test that was run again, with what failed at first."""
    again = _run_again(config)
    if not again:
        return
    terminalreporter.section('run again')
    for report in itertools.chain(*again.values()):
        terminalreporter.write_line(f'{report.nodeid} ({report.when}) failed at first:')
        terminalreporter.write_line(report.longreprtext)
        terminalreporter.write_line('')
    verdict = f': more than {MOST}, so this run is red' if len(again) > MOST else ''
    terminalreporter.write_line(f'{len(again)} of the tests needed a second run{verdict}')


def _run_again(config: pytest.Config) -> dict[str, list[pytest.TestReport]]:
    """The first failures of each test; none in a worker of pytest-xdist, which only reports."""
    if hasattr(config, 'workerinput'):
        return {}
    reporter = config.pluginmanager.get_plugin('terminalreporter')
    reports = [] if reporter is None else reporter.stats.get('rerun', [])
    found: dict[str, list[pytest.TestReport]] = {}
    for report in reports:
        found.setdefault(report.nodeid, []).append(report)  # in its body, at its end
    return found
