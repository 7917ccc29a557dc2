"""Whatever happens to a publisher and its readers, it confirms what has arrived, and no more."""

from hypothesis import example, given, settings
from hypothesis import strategies as st
from support.worlds.writer_worlds import Event, a_world

# How often each happens, beside the others.
KINDS = {
    'publish': 14, 'look': 12, 'looks': 4, 'flows': 3, 'ticks': 14, 'time': 2,
    'reliable': 6, 'best effort': 2, 'misreads': 1, 'unnamed': 1, 'bridge': 1, 'foreign': 2,
    'other type': 1, 'other qos': 1,
    'acknowledges': 6, 'dies': 5, 'is replaced': 2,
    'graph tells': 8, 'graph stands': 1, 'graph is unreadable': 1, 'graph is well': 2,
    'no publish': 1, 'no take': 1, 'no wait': 1, 'no create': 1, 'no event': 1, 'no destroy': 1,
    'no let go': 1,
}  # fmt: skip
EVENT = st.builds(
    Event,
    st.sampled_from([kind for kind, often in KINDS.items() for _ in range(often)]),
    how=st.integers(1, 10),
    where=st.integers(0, 3),
)
# Lists of any length would be short ones.
EVENTS = st.integers(0, 60).flatmap(lambda size: st.lists(EVENT, min_size=size, max_size=size))
# The history forgets who has died: all looks acknowledged, until the event tells.
DIES_UNTOLD = [
    Event('reliable'), Event('look'), Event('ticks', how=10), Event('publish', how=3),
    Event('dies', how=10), Event('look'), Event('ticks', how=7), Event('look'),
    Event('ticks', how=4), Event('look'),
]  # fmt: skip
# As one goes another one comes, and as many are there as before.
ANOTHER_COMES = [
    Event('reliable'), Event('look'), Event('publish', how=3), Event('is replaced'),
    Event('look'), Event('publish', how=2), Event('looks', how=10),
]  # fmt: skip
REPLACED = [
    Event('reliable'), Event('look'), Event('publish', how=3), Event('no publish'),
    Event('publish', how=2), Event('no create', how=2), Event('looks', how=10),
]  # fmt: skip


@settings(max_examples=200)
@given(events=EVENTS, asks=st.sampled_from([True, True, True, False]), bounded=st.booleans())
@example(events=DIES_UNTOLD, asks=True, bounded=True)
@example(events=ANOTHER_COMES, asks=True, bounded=True)
@example(events=REPLACED, asks=True, bounded=False)
def test_guarantee_1_whatever_happens_a_publisher_confirms_what_has_arrived_and_no_more(
    *, events: list[Event], asks: bool, bounded: bool
) -> None:
    with a_world(asks=asks, bounded=bounded) as world:
        for event in events:
            world.happens(event)
        world.ends()
