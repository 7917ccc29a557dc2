"""The application of the page, asked without a server."""

import asyncio
import json
from collections.abc import Callable
from typing import Any, Final

import httpx
from support.monitoring.monitors import TOKEN

from ros2_kafka_bridge.logs.lines import route_log, summed
from ros2_kafka_bridge.monitoring.replay_process import ReplayOrder
from ros2_kafka_bridge.monitoring.web import Page, make_app
from ros2_kafka_bridge.web.guard import names_of

from .conftest import Told

HOST: Final = '127.0.0.1:9464'
PAGE: Final = f'http://{HOST}'
ORDERING: Final = {
    'authorization': f'Bearer {TOKEN}',
    'content-type': 'application/json',
    'origin': PAGE,
}


class NoSides:
    """Kafka and ROS have not been seen yet."""

    def sections(self) -> dict[str, Any]:
        return {'broker': None, 'letters': []}

    def graph(self) -> dict[str, Any]:
        return {'problem': '', 'seen_s': None, 'topics': []}


class NoReplay:
    """Keeps what it was told to do."""

    def __init__(self) -> None:
        self.orders: list[ReplayOrder] = []
        self.runs = False

    def state(self) -> dict[str, Any] | None:
        return {'number': len(self.orders)} if self.orders else None

    def start(self, order: ReplayOrder) -> bool:
        self.orders.append(order)
        return not self.runs

    def stop(self) -> bool:
        return self.runs


class Site:
    """The application as it answers requests."""

    def __init__(self, told: Told, listen: str = '127.0.0.1') -> None:
        self.told = told
        self.client = '127.0.0.1'
        self.replay = NoReplay()
        sides: Any = NoSides()
        replay: Any = self.replay
        monitoring = told.watch.config.monitoring
        more = monitoring.allowed_hosts if monitoring else []
        names = names_of(listen, 9464, more)
        log = route_log()
        page = Page(
            told.watch, sides, replay, lambda: names, lambda: False, lambda: None, log,
            summed(log, first=1, period_s=60.0),
        )  # fmt: skip
        self.app = make_app(page)

    def browser(self) -> httpx.AsyncClient:
        """Make what asks it."""
        transport = httpx.ASGITransport(self.app, client=(self.client, 1))
        return httpx.AsyncClient(transport=transport, base_url=PAGE)

    def ask(
        self, method: str, path: str, headers: dict[str, str] | None = None, content: Any = None
    ) -> httpx.Response:
        async def once() -> httpx.Response:
            async with self.browser() as client:
                body = content if isinstance(content, bytes) else json.dumps(content).encode()
                sent = b'' if content is None else body
                return await client.request(method, f'/{path}', headers=headers, content=sent)

        return asyncio.run(once())

    async def leave(self, path: str) -> list[Any]:
        """Begin a request that orders something, and go before its body is there.

        Returns:
            What was sent all the same.
        """
        sent: list[Any] = []
        coming = [{'type': 'http.request', 'body': b'{', 'more_body': True}]

        async def receive() -> Any:
            return coming.pop(0) if coming else {'type': 'http.disconnect'}

        async def send(message: Any) -> None:
            sent.append(message)

        headers = [(name.encode(), value.encode()) for name, value in ORDERING.items()]
        scope = {
            'type': 'http', 'asgi': {'version': '3.0'}, 'http_version': '1.1', 'scheme': 'http',
            'method': 'POST', 'path': f'/{path}', 'raw_path': f'/{path}'.encode(),
            'query_string': b'', 'root_path': '', 'client': (self.client, 1),
            'server': ('127.0.0.1', 9464), 'headers': [(b'host', HOST.encode()), *headers],
        }  # fmt: skip
        await self.app(scope, receive, send)
        return sent

    def get(self, path: str, **headers: str) -> httpx.Response:
        return self.ask('GET', path, headers)

    def post(self, path: str, content: Any = None, **headers: str) -> httpx.Response:
        given = {name.replace('_', '-'): value for name, value in headers.items()}
        wanted = {**ORDERING, **given}
        return self.ask('POST', path, {n: v for n, v in wanted.items() if v}, content or {})


async def until(condition: Callable[[], bool]) -> None:
    """Wait until it holds."""
    async with asyncio.timeout(30):
        while not condition():  # noqa: ASYNC110 (nobody tells when it holds)
            await asyncio.sleep(0.02)
