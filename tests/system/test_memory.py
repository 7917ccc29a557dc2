"""A bridge holds no more for having moved more: memory, threads, open files.

`benchmarks/soak.py` does the same for minutes; `benchmarks/churn.py` does it with publishers and
subscribers that come and go.
"""

import sys
from functools import partial
from pathlib import Path
from typing import Final

import pytest
from support.bridges.routes import to_kafka, to_ros
from support.processes.harness import Bench, eventually

from benchmarks.vitals import Vitals, slope, vitals

ROUND: Final = 20_000
WARM_UP: Final = 5
ROUNDS: Final = 12
WAIT_S: Final = 60.0
# A message there and back: 2 to 5 were measured after this warm-up, which is what the allocators
# still gain, and goes on to fall. Twenty bytes that one of the routes kept of each were 22 to 23.
MOST_BYTES: Final = 12.0


@pytest.mark.timeout(600)
def test_a_bridge_holds_no_more_for_each_message_that_it_has_moved(
    bench: Bench, topic: str
) -> None:
    returned = f'{topic}.returned'
    config = bench.config([to_ros(topic, '/orders'), to_kafka('/orders', returned)])
    seen: list[Vitals] = []
    # Not forked from the tests: what it shares with them would become its own by and by.
    with bench.drained(config, python=Path(sys.executable)) as bridge:
        for moved in range(ROUND, (WARM_UP + ROUNDS + 1) * ROUND, ROUND):
            bench.produce(topic, [b'order %d' % moved] * ROUND)
            eventually(partial(bench.reaches, returned, moved), WAIT_S, bridge.output)
            eventually(partial(_is_confirmed, bench, topic, moved), WAIT_S, bridge.output)
            seen.append(vitals(bridge.pid))
    warm = seen[WARM_UP:]
    grown = slope([(at * ROUND, 1024.0 * it.anon_kib) for at, it in enumerate(warm)])
    # A queue that was longer once on a busy machine is a step: its error is large.
    assert grown.least < MOST_BYTES, (grown, [it.anon_kib for it in seen])
    assert warm[-1].threads <= warm[0].threads
    assert warm[-1].descriptors <= warm[0].descriptors


def _is_confirmed(bench: Bench, topic: str, count: int) -> bool:
    return bench.committed(bench.group, topic) == count
