"""Answers that are made once for all who ask."""

import asyncio
import weakref
from collections.abc import Awaitable, Callable

import pytest

from ros2_kafka_bridge.monitoring import shared_cache
from ros2_kafka_bridge.monitoring.shared_cache import SharedCache


class Making:
    """Counts what it has made, and how much of it at once."""

    def __init__(self) -> None:
        self.made: list[str] = []
        self.at_once = self.most_at_once = 0

    def of(self, name: str) -> Callable[[], Awaitable[str]]:
        async def make() -> str:
            self.at_once += 1
            self.most_at_once = max(self.most_at_once, self.at_once)
            await asyncio.sleep(0.01)
            self.at_once -= 1
            self.made.append(name)
            return f'{name} {len(self.made)}'

        return make


def _same() -> object:
    return 1


def test_who_comes_while_it_is_made_or_soon_after_gets_the_same() -> None:
    making, cache = Making(), SharedCache[str](60)

    async def run() -> list[str]:
        first = await asyncio.gather(*[cache.get('a', making.of('a'), _same) for _ in range(50)])
        return [*first, await cache.get('a', making.of('a'), _same)]

    assert asyncio.run(run()) == ['a 1'] * 51


def test_one_is_made_at_a_time_and_few_are_kept() -> None:
    making, cache = Making(), SharedCache[str](60, most=2)

    async def run() -> None:
        await asyncio.gather(*[cache.get(n, making.of(n), _same) for n in 'abc'])
        for name in 'bca':
            await cache.get(name, making.of(name), _same)

    asyncio.run(run())
    assert making.made == ['a', 'b', 'c', 'a']
    assert making.most_at_once == 1


def test_what_is_old_or_made_of_something_else_is_made_anew() -> None:
    making, of = Making(), ['report 1']

    async def run() -> list[str]:
        cache, short = SharedCache[str](60), SharedCache[str](0)
        found = [await cache.get('a', making.of('a'), lambda: of[0])]
        of[0] = 'report 2'
        found += [await cache.get('a', making.of('a'), lambda: of[0]) for _ in range(2)]
        return found + [await short.get('a', making.of('a'), _same) for _ in range(2)]

    assert asyncio.run(run()) == ['a 1', 'a 2', 'a 2', 'a 3', 'a 4']


def test_who_had_to_wait_for_others_takes_what_was_made_meanwhile() -> None:
    making, cache = Making(), SharedCache[str](0)

    async def run() -> list[str]:
        return await asyncio.gather(*[cache.get(n, making.of(n), _same) for n in 'abab'])

    assert asyncio.run(run()) == ['a 1', 'b 2', 'a 1', 'b 2']


def test_what_is_old_does_not_stay_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shared_cache, '_WAITED_FOR_S', 0.0)

    class Large:
        """An answer."""

    made: list[weakref.ref[Large]] = []

    async def make() -> Large:
        answer = Large()
        made.append(weakref.ref(answer))
        return answer

    async def run() -> None:
        cache = SharedCache[Large](0)
        for name in 'abc':
            await cache.get(name, make, _same)
        assert [it() for it in made[:2]] == [None, None]

    asyncio.run(run())


def test_what_changes_while_it_is_made_is_made_anew_for_the_next() -> None:
    making, cache, of = Making(), SharedCache[str](60), ['before']

    async def run() -> tuple[str, str]:
        first = asyncio.create_task(cache.get('a', making.of('a'), lambda: of[0]))
        await asyncio.sleep(0)
        of[0] = 'after'
        second = await cache.get('a', making.of('a'), lambda: of[0])
        return await first, second

    assert asyncio.run(run()) == ('a 1', 'a 2')


def test_an_answer_that_could_not_be_made_is_not_kept() -> None:
    making, cache = Making(), SharedCache[str](60)

    async def fail() -> str:
        raise SystemExit(1)

    async def run() -> str:
        with pytest.raises(SystemExit):
            await cache.get('a', fail, _same)
        return await cache.get('a', making.of('a'), _same)

    assert asyncio.run(run()) == 'a 1'
