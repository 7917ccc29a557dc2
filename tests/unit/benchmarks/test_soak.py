"""What the soak says of a bridge's memory, and that it is judged."""

import os
import random
from collections.abc import Callable

import pytest
from rich.console import Console

from benchmarks.soak import Around, Rates, Result, Way, show
from benchmarks.vitals import Vitals, held, vitals

MINUTES = 10


def soaked(kib: Callable[[float], float], minutes: float = MINUTES) -> Result:
    """A run whose memory is a function of the minute, with noise as a bridge has it."""
    noise = random.Random(3)  # noqa: S311 -- chance, no secret
    seen = [
        Vitals(1000.0 + second, int(kib(second / 60) + noise.gauss(0, 300)), 20, 30)
        for second in range(int(minutes * 60))
    ]
    way = Way(1000, 0, 0)
    memory = ({'heap': 9000, 'arenas': 20_000}, {'heap': 9000, 'arenas': 20_900})
    around = [Around(2, 4), Around(2, 4)]
    return Result(Rates(100, 100), seen, around, 12 * minutes, memory, 0, way, way, 0)


def test_memory_that_goes_on_to_grow_is_a_fault_and_what_holds_it_is_said(
    capsys: pytest.CaptureFixture[str],
) -> None:
    result = soaked(lambda minute: 60_000 + 132 * minute)
    assert not result.sound
    show(result, Console(width=200, highlight=False))
    assert 'grown: memory (arenas +900 KiB)' in capsys.readouterr().out


def test_memory_that_has_settled_by_half_time_is_none() -> None:
    assert soaked(lambda minute: 60_000 + 400 * min(minute, MINUTES / 2)).sound
    assert soaked(lambda _: 60_000).sound


def test_a_run_that_is_too_short_to_tell_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    result = soaked(lambda minute: 60_000 + 400 * minute, 2.0)
    assert result.sound, 'a bridge has not settled yet'
    show(result, Console(width=200, highlight=False))
    assert 'too short to tell whether it grows' in capsys.readouterr().out


def test_what_holds_the_memory_of_a_process_is_all_of_it() -> None:
    found, whole = held(os.getpid()), vitals(os.getpid()).anon_kib
    assert set(found) <= {'heap', 'arenas', 'mapped', 'files'}
    assert sum(found.values()) == pytest.approx(whole, rel=0.1)


def test_a_process_that_has_ended_holds_nothing() -> None:
    with pytest.raises(ProcessLookupError):
        held(2**22 + 1)
