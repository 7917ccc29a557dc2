"""Answers that are the same for everybody: each is made once, and given for a moment."""

import asyncio
import time
from collections.abc import Awaitable, Callable, Hashable
from typing import Final, Generic, NamedTuple, TypeVar

_WAITED_FOR_S: Final = 60.0  # somebody may wait for so long for what was made meanwhile
_Answer = TypeVar('_Answer')


class _Kept(NamedTuple, Generic[_Answer]):
    answer: _Answer
    version: object
    until_s: float


class SharedCache(Generic[_Answer]):
    """Keeps what was made last, and makes one answer at a time: whoever comes meanwhile waits.

    An answer that could not be made is not kept.

    Args:
        kept_s: For how long an answer is given.
        most: How many different ones are kept; the oldest goes first.
    """

    def __init__(self, kept_s: float, most: int = 16) -> None:
        self._kept_s = kept_s
        self._most = most
        self._kept: dict[Hashable, _Kept[_Answer]] = {}
        self._making = asyncio.Lock()

    async def get(
        self, key: Hashable, make: Callable[[], Awaitable[_Answer]], version: Callable[[], object]
    ) -> _Answer:
        """The answer that is kept, or else a new one.

        Args:
            key: What is asked for.
            make: Makes it.
            version: What it is made of: once that is another, no older answer is given.
        """
        came_s = time.monotonic()
        if (kept := self._fresh(key, version(), came_s)) is not None:
            return kept.answer
        async with self._making:
            now = version()
            # What was made since is new enough, however long others were waited for.
            if (kept := self._fresh(key, now, came_s)) is None:
                kept = _Kept(await make(), now, time.monotonic() + self._kept_s)
                self._keep(key, kept)
            return kept.answer

    def _keep(self, key: Hashable, made: _Kept[_Answer]) -> None:
        gone_s = time.monotonic() - _WAITED_FOR_S
        others = [it for it in self._kept.items() if it[0] != key and it[1].until_s > gone_s]
        self._kept = dict([*others, (key, made)][-self._most :])

    def _fresh(self, key: Hashable, version: object, came_s: float) -> _Kept[_Answer] | None:
        kept = self._kept.get(key)
        if kept is None or kept.version != version:
            return None
        return kept if came_s <= kept.until_s else None
