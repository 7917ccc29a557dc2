"""Whatever happens to a member of a group, the group is told what has ended, and all of it."""

from hypothesis import example, given, settings
from hypothesis import strategies as st
from support.worlds.group_worlds import Event, a_world

# How often each happens, beside the others.
KINDS = {
    'poll': 16, 'stay': 2, 'end': 12, 'commit': 8, 'time': 1,
    'records': 10, 'marks': 2, 'transaction': 1, 'its end': 2, 'compaction': 1, 'retention': 2,
    'partition': 1, 'share': 5, 'session ends': 4, 'another': 3,
    'away': 1, 'back': 3, 'late answers': 1, 'answers': 3, 'refusals': 1, 'unsaid': 1,
    'no metadata': 1,
    'fenced': 1, 'fatal': 1, 'no brokers': 1,
    'fails': 1, 'stops': 1, 'is killed': 1,
}  # fmt: skip
EVENT = st.builds(
    Event,
    st.sampled_from([kind for kind, often in KINDS.items() for _ in range(often)]),
    where=st.integers(0, 5),
    how=st.integers(1, 12),
    when=st.sampled_from([0, 0, 1, 2, 3]),
)
# Lists of any length would be short ones.
EVENTS = st.integers(0, 60).flatmap(lambda size: st.lists(EVENT, min_size=size, max_size=size))
# Back where another has read on, it has not heard of the new end yet.
ANOTHER_READ_ON = [
    Event('records', how=3), Event('poll', where=5, how=9), Event('end', how=4),
    Event('session ends'), Event('records', how=5), Event('another', how=9),
    Event('stay', how=2),
]  # fmt: skip
# It fails before it has committed, and meets the same gap again.
GAP_MET_AGAIN = [
    Event('poll', where=4, how=9), Event('records', how=5), Event('retention', how=3),
    Event('poll', where=4, how=9), Event('away'), Event('fails'), Event('back'),
]  # fmt: skip


@settings(max_examples=200)
@given(events=EVENTS, partitions=st.integers(1, 3), start=st.sampled_from(['earliest', 'latest']))
@example(events=GAP_MET_AGAIN, partitions=1, start='earliest')
@example(events=ANOTHER_READ_ON, partitions=1, start='earliest')
def test_guarantee_1_whatever_happens_the_group_is_told_what_has_ended_and_all_of_it(
    events: list[Event], partitions: int, start: str
) -> None:
    with a_world(partitions, start) as world:
        for event in events:
            world.happens(event)
        world.ends()
