"""A run: the plan is carried out, then everything that came is held against what was sent."""

import threading
import time
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from benchmarks.faults import journal
from benchmarks.faults.checker import (
    Allowance,
    Row,
    Verdict,
    Window,
    by_stream_and_fault,
    compare,
    judge,
    not_removable,
    summed,
)
from benchmarks.faults.faults import FAULTS
from benchmarks.faults.kinds.fault import NOTHING
from benchmarks.faults.parts import tell_stacks
from benchmarks.faults.plan import Step
from benchmarks.faults.setting import Setting
from benchmarks.faults.streams import Stream
from benchmarks.faults.world import HAND_OVER_NS, PUBLISHER_HISTORY, World, running

SETTLE_S: Final = 120.0
AROUND: Final = 'none'
"""In the place of a fault, for what was sent before the first and after the last one."""

Tell = Callable[[str], None]


class Outcome(NamedTuple):
    """What a run has found.

    Args:
        done: Faults that were injected; all of the plan, unless somebody stopped it.
        breaches: What no window explains, in words.
    """

    rows: Sequence[Row]
    verdicts: Sequence[Verdict]
    windows: Sequence[Window]
    done: int
    breaches: Sequence[str]

    @property
    def is_good(self) -> bool:
        """Whether nothing happened that the guarantees do not allow."""
        return not self.breaches and not any(row.wrong for row in self.rows)


def run(setting: Setting, plan: Sequence[Step], stop: threading.Event, tell: Tell) -> Outcome:
    """Carry out a plan.

    Raises:
        ProcessError: A part ended by itself, or could not be started.
        TransportError: Kafka did.
    """
    tell(f'starting Kafka ({setting.brokers}), a bridge and {len(setting.streams)} streams ...')
    with running(setting, stop) as world:
        tell('all streams flow')
        windows = _inject(world, plan, tell)
        tell('no more faults: waiting for what is on its way ...')
        late = world.finish()
        breaches = [f'{name} did not come to its end' for name in late]
        breaches += [f'a bridge ended with status {s}, see its log' for s in world.end() if s != 0]
        now_ns = time.time_ns()
        before = Window(AROUND, 0, None, windows[0].start_ns if windows else now_ns)
        after = Window(AROUND, windows[-1].end_ns if windows else now_ns, None, now_ns)
        tell('comparing what came with what was sent ...')
        verdicts = []
        for stream in setting.streams:
            found, wrong = _judge(world, stream, [before, *windows, after])
            verdicts += found
            breaches += [f'{stream.name}: {words}' for words in wrong]
    return Outcome(_rows(setting, verdicts), verdicts, windows, len(windows), breaches)


def _inject(world: World, plan: Sequence[Step], tell: Tell) -> list[Window]:
    windows: list[Window] = []
    for place, step in enumerate(plan, 1):
        world.pause(step.wait_s)
        if world.stop.is_set():
            break
        tell(f'{place}/{len(plan)} {FAULTS[step.fault].words} ...')
        window = _one(world, step)
        tell(f'    all is well again after {(window.end_ns - window.start_ns) / 1e9:.1f} s')
        windows.append(window)
        if window.late:
            tell(f'    but for {", ".join(window.late)}: the run ends here')
            for bridge in world.bridges:
                tell_stacks(bridge)
            for name in window.late:
                for words in world.says(name):
                    tell(f'        {words}')
            break
    return windows


def _one(world: World, step: Step) -> Window:
    """Inject one fault, mend it, and wait until all is well again."""
    fault = FAULTS[step.fault]
    target = fault.aims_at(world, step.target) if fault.aims_at else ''
    world.away_ns = None
    start_ns = time.time_ns()
    fault.inject(world, step.target)
    world.pause(step.hold_s)
    back_ns = fault.recover(world, step.target)
    mended_s = time.monotonic()
    late = world.settle(SETTLE_S)
    world.pause(mended_s + fault.after_s - time.monotonic())
    return Window(
        fault.name, start_ns, back_ns, time.time_ns(), step.hold_s, target, late,
        world.away_ns, fault.by_another,
    )  # fmt: skip


def _judge(
    world: World, stream: Stream, windows: Sequence[Window]
) -> tuple[list[Verdict], list[str]]:
    """What happened to a stream in each window, and what is wrong with all of it."""
    ends, records = world.ends(stream)
    found = compare(ends)
    verdicts = []
    since_ns = 0
    handed_ns = world.hand_overs_ns(stream)
    for window in windows:
        allowance = allowed(stream, window, world.setting.bridges)
        if any(since_ns - HAND_OVER_NS < at_ns <= window.end_ns for at_ns in handed_ns):
            allowance = _handed_over(stream, allowance)
        verdicts.append(judge(stream.name, ends, found, window, since_ns, allowance))
        since_ns = window.end_ns
    wrong = []
    if twice := not_removable((r.number, r.place) for r in records if r.number is not None):
        wrong.append(f'{len(twice)} repeats that (gid, seq) does not tell')
    kept = {seen.number for seen in ends.arrived}
    live = journal.read(world.progress[stream.name].arrived_file)
    gone = {entry.number for entry in live if entry.mark == journal.ARRIVED} - kept
    if gone:
        wrong.append(f'{len(gone)} orders were in Kafka and are no longer')
    return verdicts, wrong


def allowed(stream: Stream, window: Window, bridges: int) -> Allowance:
    """What a window may cost a stream that so many bridges carry."""
    if window.fault == AROUND:
        return NOTHING
    found = FAULTS[window.fault].allows(stream, window.hold_s)
    if not stream.is_from_kafka:
        return found
    # They share the partitions, and each has a window of its own that may come again.
    return found._replace(out_of_order=found.out_of_order * bridges)


def _handed_over(stream: Stream, allowance: Allowance) -> Allowance:
    """Both bridges read for a while; what one holds may come behind what the other has read."""
    if stream.is_from_kafka:
        return allowance._replace(duplicated=True)
    late = PUBLISHER_HISTORY + stream.in_bridge
    return allowance._replace(duplicated=True, out_of_order=late)


def _rows(setting: Setting, verdicts: Sequence[Verdict]) -> list[Row]:
    streams = {stream.name: stream for stream in setting.streams}
    rows = []
    for (name, fault), own in by_stream_and_fault(verdicts).items():
        required_s, why = None, ''
        if fault != AROUND:
            kind = FAULTS[fault]
            required_s = kind.limit_s(streams[name])
            longest = max(kind.hold_s)
            why = kind.allows(streams[name], longest).why
        rows.append(summed(own, required_s, why))
    return rows
