"""ROS nodes that come and go, some killed, on the topics of a steady reader and publisher."""

from support.processes.harness import Bench

from benchmarks.churn import play

VISITS = 30


def test_visitors_cost_the_steady_ones_no_message_and_the_bridge_no_thread_or_descriptor(
    bench: Bench,
) -> None:
    result = play(bench.bootstrap_servers, bench.place, bench.domain, VISITS)
    assert result.lost == 0, result
    assert result.status == 0
    assert min(result.sent) > 0
    first, *_, last = result.seen
    assert (last.threads, last.descriptors) <= (first.threads, first.descriptors)
