"""A configuration that is changed while the bridge runs, in one process.

With workers and with monitoring, and all else about reloads: tests/system/test_reload.py.
"""

from support.bridges.reloads import keeps_the_routes_that_stay, refuses_a_bad_file
from support.processes.harness import Bench


def test_a_reload_under_load_loses_and_repeats_nothing_on_the_routes_that_stay(
    bench: Bench, topic: str
) -> None:
    keeps_the_routes_that_stay(bench, topic)


def test_a_bad_file_is_refused_with_every_mistake_and_all_goes_on(
    bench: Bench, topic: str, returned: str
) -> None:
    refuses_a_bad_file(bench, topic, returned)
