"""A bridge sends what the spool of an earlier version of it holds, once and in order."""

import pytest
from support.bridges.routes import totals
from support.bridges.spooled import file, route
from support.processes.harness import Bench, headers
from support.spools.files import STATES, VERSIONS, held, put

from rig.topics import records


@pytest.mark.parametrize('state', STATES)
@pytest.mark.parametrize('version', VERSIONS)
def test_a_bridge_sends_what_an_earlier_version_has_left_on_disk(
    own_bench: Bench, version: int, state: str
) -> None:
    put(version, state, file(own_bench))
    own_bench.create_topic('orders', 'orders.dead-letters')
    with own_bench.drained(own_bench.config([route(own_bench, 'orders')])) as bridge:
        bridge.wait_for('the spool is empty again')
    sent = [row.record for row in held(state)]
    for topic in ('orders', 'orders.dead-letters'):
        found = list(records(own_bench.bootstrap_servers, topic))
        wanted = [record for record in sent if record.topic == topic]
        assert [(it.key(), it.value()) for it in found] == [(it.key, it.value) for it in wanted]
        assert [headers(it)['ros.seq'] for it in found] == [
            str(row.seq) for row in held(state) if row.record.topic == topic
        ]
    told = totals(bridge, 'to_kafka')
    assert (told['confirmed'], told['dead-lettered']) == (len(sent) - 1, 1)
