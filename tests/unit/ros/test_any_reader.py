"""Whatever happens to a ROS source, it hands over all that came, once and in its order."""

from hypothesis import example, given, settings
from hypothesis import strategies as st
from support.worlds.reader_worlds import Event, a_world

from ros2_kafka_bridge.config.settings import QoS

# How often each happens, beside the others.
KINDS = {
    'publish': 20, 'publisher': 5, 'leaves': 4, 'shown': 6, 'graph': 5, 'far': 1, 'near': 2,
    'time': 6, 'take': 24, 'wait': 5, 'look': 5, 'hash': 3,
    'take fails': 5, 'no subscription': 1, 'sticks': 1, 'no ringing': 2, 'well': 3,
    'stranger': 2, 'no graph': 2, 'graph again': 4, 'graph tells': 8,
    'away': 2, 'refuses': 1, 'back': 4,
}  # fmt: skip
FIRST = {'publisher': 4, 'publish': 2, 'graph': 2, 'away': 1}


def _drawn(kinds: dict[str, int]) -> st.SearchStrategy[Event]:
    """All in one go, which is much faster."""
    return st.sampled_from(
        [
            Event(kind, where, how)
            for kind, often in kinds.items()
            for where in range(6)
            for how in range(1, 13)
            for _ in range(often)
        ]
    )


EVENT = _drawn(KINDS)
BEFORE = st.lists(_drawn(FIRST), max_size=8)
# Lists of any length would be short ones.
EVENTS = st.integers(0, 80).flatmap(lambda size: st.lists(EVENT, min_size=size, max_size=size))
QOS = st.sampled_from(
    [
        *4 * [QoS()],
        QoS(reliability='reliable'),
        QoS(durability='volatile'),
        QoS(reliability='best_effort', durability='transient_local'),
    ]
)
SHOWN = [Event('graph'), Event('graph tells')]
# What the last publisher of an offer has sent is there still when the graph shows it no more.
LEAVES_UNREAD = [
    Event('publisher', how=4), Event('publisher', how=5), *SHOWN,
    Event('take', where=3, how=10), Event('take', where=3, how=10),
    Event('leaves', how=7), Event('graph tells'), Event('look', where=2),
]  # fmt: skip
# Each fails once, and nothing of that lasts.
FAILURES_ALONE = [
    Event('publisher', how=4), *SHOWN, Event('take', where=3, how=10),
    Event('wait', how=3), Event('no ringing'), Event('wait', how=3), Event('wait', how=3),
    *2 * [Event('take fails', how=3), *3 * [Event('take', how=10)]],
]  # fmt: skip
# A subscription that cannot be read, nor made anew, is kept with all that lies in it.
CANNOT_BE_MADE_ANEW = [
    Event('publisher', how=4), *SHOWN, Event('take', where=3, how=10),
    Event('publish', how=3), Event('no subscription'), Event('take fails', how=2),
    *6 * [Event('take', how=10)],
]  # fmt: skip


# A middleware that does not ring is looked at all the same, before the wait is over.
NEVER_RINGS = [
    Event('no ringing'), Event('publisher', how=5), *SHOWN,
    Event('take', where=3, how=10), *3 * [Event('wait', how=3)],
]  # fmt: skip


# One whose history is kept is met in the midst of a take, and may have been read before.
MET_IN_A_TAKE = [
    Event('publisher', where=1, how=1), Event('publish', how=3), Event('graph'),
    Event('take', how=10), Event('take', how=10),
]  # fmt: skip


@settings(max_examples=200)
@given(before=BEFORE, events=EVENTS, qos=QOS, seed=st.integers(0, 99))
@example(before=[], events=LEAVES_UNREAD, qos=QoS(), seed=0)
@example(before=[], events=NEVER_RINGS, qos=QoS(), seed=0)
@example(before=[], events=MET_IN_A_TAKE, qos=QoS(), seed=0)
@example(before=[], events=FAILURES_ALONE, qos=QoS(), seed=0)
@example(before=[], events=CANNOT_BE_MADE_ANEW, qos=QoS(), seed=0)
def test_guarantee_1_whatever_happens_all_that_came_is_handed_over_once_and_in_order(
    before: list[Event], events: list[Event], qos: QoS, seed: int
) -> None:
    _live(before, events, qos, seed, has_gid=True)


@settings(max_examples=50)
@given(before=BEFORE, events=EVENTS, qos=QOS, seed=st.integers(0, 99))
def test_guarantee_1_without_their_publishers_all_messages_are_handed_over_as_they_came(
    before: list[Event], events: list[Event], qos: QoS, seed: int
) -> None:
    _live(before, events, qos, seed, has_gid=False)


def _live(before: list[Event], events: list[Event], qos: QoS, seed: int, *, has_gid: bool) -> None:
    with a_world(qos, seed, has_gid=has_gid) as world:
        for event in before:
            world.happens(event)
        world.opens()
        for event in events:
            world.happens(event)
        world.ends()
