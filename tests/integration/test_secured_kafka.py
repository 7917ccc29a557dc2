"""A closed cluster: in by password, with the permissions of docs/security.md and no more.

The other ways in, and what goes wrong on them, are in tests/system and tests/faults.
"""

from pathlib import Path

import pytest
from support.kafka.secured import carries_orders, running
from support.processes.harness import Bench


def test_orders_go_through_both_directions_with_the_permissions_of_the_docs(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, ros_domain: int
) -> None:
    with running(tmp_path_factory.mktemp('secured')) as secured:
        bench = Bench(tmp_path, secured.node.bootstrap_servers, ros_domain)
        carries_orders(secured, bench, 'SCRAM')
        bench.close()
