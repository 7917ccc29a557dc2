"""The page's server: static files, server-sent events, and what a browser may ask for."""

import asyncio
import contextlib
import logging
import time
import uuid
from collections.abc import AsyncIterator, Awaitable, Callable
from http import HTTPStatus
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from ros2_kafka_bridge.web.events import Events
from ros2_kafka_bridge.web.files import file_routes
from ros2_kafka_bridge.web.guard import Guard, Names, Refusal, read_body, refused, without_json
from ros2_kafka_warehouse.domain.site import Site
from ros2_kafka_warehouse.page.feed import Feed
from ros2_kafka_warehouse.page.forms import BadForm, read_command, read_order, read_rate
from ros2_kafka_warehouse.page.outbox import NotSent, Outbox
from ros2_kafka_warehouse.page.random_orders import RandomOrders
from ros2_kafka_warehouse.page.view import View

_LOG: Final = logging.getLogger(__name__)

STATIC: Final = Path(__file__).parent / 'static'

_CURE: Final = 'start it with --allow-host to serve that name'
_PUSH_S = 0.1
_TICK_S = 1.0
_ALIVE_S = 2.0
_SLOW_S = 10.0  # the longest call of either Kafka client takes a second or two
_MOST_BODY_BYTES = 64 * 1024


class Page(NamedTuple):
    """What a page is made of.

    Attributes:
        failures: Codes that a robot can be failed with, with words for people.
        names: What may stand in `Host`.
        stopping: Whether the server is to end: streams of events then end, too.
        give_up: Ends the process as failed, so that its supervisor starts it again.
        orders_per_minute: Random orders to begin with.
        alive: A file that is touched as long as records come in and go out.
    """

    site: Site
    failures: dict[str, str]
    bootstrap_servers: str
    names: Names
    stopping: Callable[[], bool]
    give_up: Callable[[], None]
    orders_per_minute: float = 0.0
    alive: Path | None = None


def make_app(page: Page) -> Starlette:
    """The page as an ASGI application; its Kafka clients live as long as its lifespan."""
    desk = _Desk(page)
    routes = [
        *file_routes(STATIC),
        Route('/api/site', desk.site),
        Route('/api/events', desk.events, methods=['GET']),
        Route('/api/orders', desk.order, methods=['POST']),
        Route('/api/commands', desk.command, methods=['POST']),
        Route('/api/rate', desk.rate, methods=['POST']),
    ]
    guard = Middleware(Guard, names=lambda: page.names, cure=_CURE)
    return Starlette(routes=routes, middleware=[guard], lifespan=desk.lifespan)


class _Desk:
    def __init__(self, page: Page) -> None:
        self._page = page
        self._view = View(page.site)
        self.events = Events(self._view.newer, page.stopping, 'warehouse', _PUSH_S)
        self._site = msgspec.json.encode({'site': page.site, 'failures': page.failures})

    @contextlib.asynccontextmanager
    async def lifespan(self, _app: Starlette) -> AsyncIterator[None]:
        servers = self._page.bootstrap_servers
        self._feed = Feed(servers, self._view)
        self._outbox = Outbox(servers)
        self._random_orders = RandomOrders(self._page.site, self._outbox, new_order_id, time.time)
        self._random_orders.set(self._page.orders_per_minute)
        async with asyncio.TaskGroup() as tasks:
            feed = tasks.create_task(self._must_work(self._feed.run(self._page.stopping)))
            rest = [
                tasks.create_task(self._must_work(work))
                for work in (
                    self._outbox.serve(),
                    self._random_orders.run(),
                    self._tick(),
                    self._stay_alive(),
                )
            ]
            yield
            await feed
            for task in rest:
                task.cancel()

    async def _must_work(self, work: Awaitable[None]) -> None:
        """A page without one of its parts would show old data for ever: it ends instead."""
        try:
            await work
        except Exception:  # noqa: BLE001 (whatever it is, the log has it)
            _LOG.exception('a part of the page has failed: the page ends')
            self._page.give_up()

    async def _stay_alive(self) -> None:
        """A supervisor starts the page again when this file becomes old."""
        while self._page.alive is not None:
            worked_s = min(self._feed.worked_s, self._outbox.worked_s)
            if time.monotonic() - worked_s < _SLOW_S:
                with contextlib.suppress(OSError):  # its age says so, too
                    self._page.alive.touch()
            await asyncio.sleep(_ALIVE_S)

    async def _tick(self) -> None:
        while True:
            self._view.tick(
                time.time(), kafka_away=self._feed.away, rate=self._random_orders.per_minute
            )
            await asyncio.sleep(_TICK_S)

    async def site(self, _request: Request) -> Response:
        return Response(self._site, media_type='application/json')

    async def order(self, request: Request) -> Response:
        async def send(body: bytes) -> dict[str, Any]:
            order = read_order(body, self._page.site, new_order_id(), time.time())
            await self._outbox.send_order(order)
            return {'orderId': order.order_id}

        return await _answer(request, send)

    async def command(self, request: Request) -> Response:
        async def send(body: bytes) -> dict[str, Any]:
            failures = frozenset(self._page.failures)
            command = read_command(
                body, self._page.site, self._view.robots, failures, f'page-{uuid.uuid4().hex[:12]}'
            )
            command = msgspec.structs.replace(command, time_s=time.time())
            await self._outbox.send_command(command)
            return {'commandId': command.command_id}

        return await _answer(request, send)

    async def rate(self, request: Request) -> Response:
        async def change(body: bytes) -> dict[str, Any]:
            self._random_orders.set(read_rate(body))
            return {'perMinute': self._random_orders.per_minute}

        return await _answer(request, change)


async def _answer(request: Request, act: Callable[[bytes], Any]) -> Response:
    try:
        body = without_json(request.headers) or await read_body(request, _MOST_BODY_BYTES)
    except ClientDisconnect:  # nobody hears the answer
        body = Refusal(HTTPStatus.BAD_REQUEST, 'the body did not come to its end')
    if isinstance(body, Refusal):
        return refused(body)
    try:
        return JSONResponse(await act(body), HTTPStatus.ACCEPTED)
    except BadForm as error:
        return refused(Refusal(HTTPStatus.BAD_REQUEST, str(error)))
    except NotSent as error:
        text = f'Kafka did not take it: {error}'
        return refused(Refusal(HTTPStatus.SERVICE_UNAVAILABLE, text))


def new_order_id() -> str:
    """A name that no other page gives an order."""
    return f'W-{uuid.uuid4().hex[:12].upper()}'
