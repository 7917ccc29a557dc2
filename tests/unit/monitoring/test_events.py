"""The stream of events: what it tells, and who has to go where too many look."""

import asyncio
import logging
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, Final

import pytest
from starlette.types import Message
from support.monitoring.monitors import TOKEN

from ros2_kafka_bridge.logs.lines import route_log, summed
from ros2_kafka_bridge.monitoring import rights
from ros2_kafka_bridge.monitoring.board import Board
from ros2_kafka_bridge.monitoring.rights import Rights
from ros2_kafka_bridge.web.events import Events
from ros2_kafka_bridge.web.viewers import MOST

from .conftest import Told
from .sites import until

SCOPE: Final[dict[str, Any]] = {
    'type': 'http', 'method': 'GET', 'headers': [], 'client': ('10.1.2.3', 1),
}  # fmt: skip


def made(told: Told, board: Board, stopping: Callable[[], bool]) -> Events:
    said = summed(route_log(), first=1)
    rights = Rights(told.watch, said)
    return Events(board.newer, stopping, 'bridge', 0.02, rights.reject_wrong_token, said)


class Browser:
    """One that takes what is sent."""

    def __init__(self) -> None:
        self.got: list[bytes] = []
        self.status = 0
        self._gone = asyncio.Event()

    async def receive(self) -> Message:
        await self._gone.wait()
        return {'type': 'http.disconnect'}

    async def send(self, message: Message) -> None:
        if message['type'] == 'http.response.start':
            self.status = message['status']
            return
        self.got.append(message['body'])

    def leave(self) -> None:
        self._gone.set()


def test_a_browser_gets_what_is_there_and_then_what_changes(told: Told) -> None:
    board, stopping = Board(), SimpleNamespace(now=False)
    board.put('a', 1)

    async def run() -> list[bytes]:
        events, browser = made(told, board, lambda: stopping.now), Browser()
        stream = asyncio.create_task(events(SCOPE, browser.receive, browser.send))
        await until(lambda: b'data: {"a":1}\n\n' in browser.got)
        board.put('b', 2)
        await until(lambda: b'data: {"b":2}\n\n' in browser.got)
        stopping.now = True
        await stream
        return browser.got

    assert asyncio.run(run())[-1] == b''


def test_where_there_are_too_many_the_oldest_is_told_and_the_newest_looks(
    told: Told, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    logger = logging.getLogger('ros2_kafka_bridge')
    monkeypatch.setattr(logger, 'handlers', [caplog.handler])
    monkeypatch.setattr(logger, 'propagate', False)

    async def run() -> None:
        events = made(told, Board(), lambda: False)
        browsers = [Browser() for _ in range(MOST + 1)]
        streams = [asyncio.create_task(events(SCOPE, it.receive, it.send)) for it in browsers]
        await streams[0]
        assert browsers[0].got[-2].startswith(b'event: full\nretry: 30000\ndata: {"error":"Too')
        assert browsers[0].got[-1] == b''
        assert events.browsers == MOST
        assert {it.status for it in browsers} == {200}
        for browser in browsers:
            browser.leave()
        await asyncio.gather(*streams)
        assert events.browsers == 0

    asyncio.run(run())
    [line] = caplog.messages
    assert line.startswith('the page: too many browsers at once')


def test_who_shows_the_token_looks_beside_all_others(told: Told) -> None:
    async def run() -> None:
        events = made(told, Board(), lambda: False)
        operator, *others = [Browser() for _ in range(2 * MOST)]
        shown = {**SCOPE, 'headers': [(b'authorization', f'Bearer {TOKEN}'.encode())]}
        asking = [(shown, operator), *(({**SCOPE}, it) for it in others)]
        streams = [asyncio.create_task(events(s, it.receive, it.send)) for s, it in asking]
        await until(lambda: events.browsers == MOST + 1)
        for browser in others:
            browser.leave()
        await until(lambda: events.browsers == 1)
        assert not streams[0].done()
        operator.leave()
        await asyncio.gather(*streams)

    asyncio.run(run())


def test_a_wrong_token_is_no_way_to_a_place(told: Told, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rights, '_WRONG_TOKEN_S', 0.0)
    wrong = {**SCOPE, 'headers': [(b'authorization', b'Bearer wrong')]}

    async def run() -> int:
        browser = Browser()
        async with asyncio.timeout(30):
            await made(told, Board(), lambda: False)(wrong, browser.receive, browser.send)
        return browser.status

    assert asyncio.run(run()) == 401


def test_what_a_proxy_hands_on_of_its_own_password_keeps_nobody_out(told: Told) -> None:
    basic = {**SCOPE, 'headers': [(b'authorization', b'Basic YWxpY2U6c2VjcmV0')]}

    async def run() -> int:
        events, browser = made(told, Board(), lambda: False), Browser()
        stream = asyncio.create_task(events(basic, browser.receive, browser.send))
        await until(lambda: events.browsers == 1)
        browser.leave()
        await stream
        return browser.status

    assert asyncio.run(run()) == 200
