"""The stream of events: for fast browsers, slow ones, and too many."""

import asyncio
from collections.abc import Callable
from types import SimpleNamespace
from typing import Final

from starlette.types import Message

from ros2_kafka_bridge.monitoring.board import Board
from ros2_kafka_bridge.monitoring.events import MOST_BROWSERS, Events

SCOPE: Final = {'type': 'http', 'method': 'GET'}


class Browser:
    """One that takes what is sent, or stands still."""

    def __init__(self, *, stands_still: bool = False) -> None:
        self.got: list[bytes] = []
        self.status = 0
        self._gone = asyncio.Event()
        self._stands_still = stands_still

    async def receive(self) -> Message:
        await self._gone.wait()
        return {'type': 'http.disconnect'}

    async def send(self, message: Message) -> None:
        if message['type'] == 'http.response.start':
            self.status = message['status']
            return
        if self._stands_still and self.got:
            await asyncio.Event().wait()
        self.got.append(message['body'])

    def leave(self) -> None:
        self._gone.set()


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(30):
        while not condition():  # noqa: ASYNC110 (nobody tells when it holds)
            await asyncio.sleep(0.02)


def test_a_browser_gets_what_is_there_and_then_what_changes() -> None:
    board, stopping = Board(), SimpleNamespace(now=False)
    board.put('a', 1)

    async def run() -> list[bytes]:
        events, browser = Events(board, lambda: stopping.now), Browser()
        stream = asyncio.create_task(events(SCOPE, browser.receive, browser.send))
        await until(lambda: b'data: {"a":1}\n\n' in browser.got)
        board.put('b', 2)
        await until(lambda: b'data: {"b":2}\n\n' in browser.got)
        stopping.now = True
        await stream
        return browser.got

    assert asyncio.run(run())[-1] == b''


def test_a_browser_that_takes_nothing_is_let_go() -> None:
    board = Board()
    board.put('a', 1)

    async def run() -> int:
        events = Events(board, lambda: False, patience_s=0.1)
        slow = Browser(stands_still=True)
        async with asyncio.timeout(30):
            await events(SCOPE, slow.receive, slow.send)
        return events.browsers

    assert asyncio.run(run()) == 0


def test_one_browser_too_many_is_refused_and_those_who_leave_make_room() -> None:
    async def run() -> None:
        events = Events(Board(), lambda: False)
        browsers = [Browser() for _ in range(MOST_BROWSERS)]
        streams = [asyncio.create_task(events(SCOPE, it.receive, it.send)) for it in browsers]
        await until(lambda: events.browsers == MOST_BROWSERS)
        late = Browser()
        await events(SCOPE, late.receive, late.send)
        assert late.status == 503
        for browser in browsers:
            browser.leave()
        await asyncio.gather(*streams)
        assert events.browsers == 0

    asyncio.run(run())
