"""The page's own work: it goes on or the process ends; nothing in between."""

import asyncio
import signal
from pathlib import Path
from typing import Any

import pytest
import typer
from starlette.requests import Request
from starlette.types import Message, Scope

from ros2_kafka_bridge.web.guard import Names
from ros2_kafka_warehouse.domain.site import Site
from ros2_kafka_warehouse.page import app
from ros2_kafka_warehouse.page.__main__ import serve
from ros2_kafka_warehouse.page.app import Page, make_app

NO_NAMES = Names(frozenset(), frozenset())
SITE = Site('small', ('....',), {'packing-1': (3, 0)}, {}, {})


class Works:
    """A Kafka client that has worked just now."""

    away = ''
    worked_s = 0.0

    def __init__(self, *_: Any) -> None:
        self.worked_s = asyncio.get_running_loop().time()  # of the monotonic clock

    async def run(self, stopping: Any) -> None:
        while not stopping():  # noqa: ASYNC110 (as the feed does)
            await asyncio.sleep(0.01)

    async def serve(self) -> None:
        await asyncio.Event().wait()


class Hangs(Works):
    """One that has not worked for a minute."""

    def __init__(self, *_: Any) -> None:
        super().__init__()
        self.worked_s -= 60


class Fails(Works):
    """One whose work ends by an error."""

    async def run(self, stopping: Any) -> None:
        assert not stopping()
        raise ValueError('year 0 is out of range')

    async def serve(self) -> None:
        raise ValueError('year 0 is out of range')


def live(
    monkeypatch: pytest.MonkeyPatch, feed: Any, outbox: Any, alive: Path | None = None
) -> list[str]:
    """Let the page live for a moment; returns how often it gave up."""
    monkeypatch.setattr(app, 'Feed', feed)
    monkeypatch.setattr(app, 'Outbox', outbox)
    given_up: list[str] = []
    ends = False
    page = Page(
        SITE, {}, '', NO_NAMES, lambda: ends, lambda: given_up.append('given up'), alive=alive
    )
    made = make_app(page)

    async def once() -> None:
        nonlocal ends
        async with made.router.lifespan_context(made):
            await asyncio.sleep(0.05)
            ends = True

    asyncio.run(once())
    return given_up


def test_a_page_whose_parts_work_does_not_give_up(monkeypatch: pytest.MonkeyPatch) -> None:
    assert live(monkeypatch, Works, Works) == []


@pytest.mark.parametrize(('feed', 'outbox'), [(Fails, Works), (Works, Fails)])
def test_a_page_of_which_a_part_ends_by_an_error_gives_up(
    monkeypatch: pytest.MonkeyPatch, feed: Any, outbox: Any
) -> None:
    assert live(monkeypatch, feed, outbox) == ['given up']


def test_the_process_of_a_page_that_gave_up_ends_as_failed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(app, 'Feed', Fails)
    monkeypatch.setattr(app, 'Outbox', Works)
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        with pytest.raises(typer.Exit) as ended:
            serve('localhost:1', port=0)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    assert ended.value.exit_code == 1


def test_the_file_of_a_page_that_works_is_touched(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    alive = tmp_path / 'page.alive'
    live(monkeypatch, Works, Works, alive)
    assert alive.exists()


@pytest.mark.parametrize(('feed', 'outbox'), [(Hangs, Works), (Works, Hangs)])
def test_the_file_of_a_page_that_hangs_becomes_old(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, feed: Any, outbox: Any
) -> None:
    alive = tmp_path / 'page.alive'
    live(monkeypatch, feed, outbox, alive)
    assert not alive.exists()


def test_a_browser_that_goes_away_in_mid_body_is_no_error() -> None:
    json = [(b'content-type', b'application/json')]
    scope: Scope = {'type': 'http', 'method': 'POST', 'path': '/', 'headers': json}
    parts: list[Message] = [
        {'type': 'http.request', 'body': b'{"comm', 'more_body': True},
        {'type': 'http.disconnect'},
    ]

    async def receive() -> Message:
        return parts.pop(0)

    async def act(_body: bytes) -> None:
        pytest.fail('half a command was done')

    answer = asyncio.run(app._answer(Request(scope, receive), act))
    assert answer.status_code == 400
