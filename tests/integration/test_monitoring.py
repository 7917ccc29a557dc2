"""Metrics of a real bridge under load (guarantee 6: counters balance)."""

from collections.abc import Callable

from support.monitoring.scrapes import ROUTES, Scrape, under_load
from support.processes.harness import Bench, eventually


def test_the_counters_of_each_scrape_balance_and_never_fall_under_load(
    bench: Bench, unique: Callable[[str], str]
) -> None:
    with under_load(bench, unique) as loaded:
        before: Scrape | None = None
        scrapes = 0

        def all_came() -> bool:
            nonlocal before, scrapes
            now = loaded.scrape()
            scrapes += 1
            for route in ('to_ros', 'to_kafka'):
                taken = now.of('messages_taken_total', route=route)
                ended = now.of('messages_ended_total', route=route)
                held = now.of('messages_in_flight', route=route)
                held += now.of('messages_spooled', route=route)
                assert taken == ended + held, (route, taken, ended, held)
            limit = now.of('sink_queue_limit_messages', route='to_ros')
            assert now.of('sink_queue_messages', route='to_ros') <= limit
            for key in before.counters if before else ():
                assert now.samples[key] >= before.samples[key], key  # type: ignore[union-attr]
            before = now
            done = [now.of('messages_ended_total', route=r, outcome='confirmed') for r in ROUTES]
            return min(done) >= 20_000

        eventually(all_came, 120, loaded.process.output)
    assert before is not None
    assert scrapes > 5
    # A message that the history's room confirms is measured, too.
    for name in ('bridge_seconds', 'end_to_end_seconds'):
        for route in ROUTES:
            assert before.of(f'{name}_count', route=route) >= 20_000, (name, route)
    assert before.of('publish_seconds_count', route='to_ros') >= 20_000
    assert before.of('produce_seconds_count', route='to_kafka') >= 20_000
    assert before.of('produce_seconds_count', route='to_ros') == 0
    assert before.of('worker_up') == 2
    assert {before.of('kafka_up', route=route) for route in ROUTES} == {1}
    assert before.of('worker_resident_memory_bytes') > 1e7
    assert before.of('bytes_confirmed_total', route='to_ros') >= 20_000
    assert before.of('route_state', route='to_ros', state='running') == 1
