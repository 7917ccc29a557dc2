"""Whatever happens to bridges that take turns, what is published is taken by one of them."""

from hypothesis import given, settings
from hypothesis import strategies as st
from support.worlds.handover_ros import Voice
from support.worlds.handover_worlds import Event, a_world

# How often each happens, beside the others.
KINDS = {
    'stop': 6, 'stop early': 2, 'stop again': 1, 'kill': 1, 'stand still': 4, 'hold up': 4,
    'fail': 1, 'move': 4, 'tell nothing': 1,
}  # fmt: skip
EVENT = st.builds(
    Event,
    st.sampled_from([kind for kind, often in KINDS.items() for _ in range(often)]),
    whom=st.sampled_from(['holder', 'leaving', 'other']),
    how=st.integers(0, 10),
    after_s=st.sampled_from([0.0, 0.3, 1.0, 2.0, 4.0, 8.0]),
)
EVENTS = st.integers(1, 24).flatmap(lambda size: st.lists(EVENT, min_size=size, max_size=size))
VOICE = st.builds(
    Voice,
    every=st.sampled_from([2, 4, 10, 60]),
    ahead_s=st.sampled_from([0.0, 3.4, -3.4, 1.0]),
    silent_s=st.tuples(st.integers(0, 40), st.integers(0, 60)),
)


@settings(max_examples=200)
@given(
    voices=st.lists(VOICE, min_size=1, max_size=3),
    events=EVENTS,
    seed=st.integers(0, 10_000),
    slots=st.sampled_from([2, 3, 3]),
)
def test_guarantee_8_whatever_happens_to_bridges_that_take_turns_one_of_them_takes_it(
    voices: list[Voice], events: list[Event], seed: int, slots: int
) -> None:
    with a_world(voices, events, seed, slots) as world:
        world.run()
        world.check()
