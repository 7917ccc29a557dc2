"""What a browser, Prometheus and Kubernetes may ask for."""

import asyncio
import contextlib
import gzip
import json
from collections.abc import AsyncIterator, Callable
from http import HTTPStatus
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
from prometheus_client.exposition import choose_encoder
from prometheus_client.registry import CollectorRegistry
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.middleware.gzip import GZipMiddleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from ros2_kafka_bridge.logs.lines import RouteLog
from ros2_kafka_bridge.monitoring import view
from ros2_kafka_bridge.monitoring.actions import Orders
from ros2_kafka_bridge.monitoring.board import Board
from ros2_kafka_bridge.monitoring.events import Events
from ros2_kafka_bridge.monitoring.failures import Failures
from ros2_kafka_bridge.monitoring.guard import Guard, Names
from ros2_kafka_bridge.monitoring.health import Health, liveness, readiness
from ros2_kafka_bridge.monitoring.history import BUCKET_S, SPAN_S
from ros2_kafka_bridge.monitoring.prometheus import BridgeCollector
from ros2_kafka_bridge.monitoring.replay import ReplayRunner
from ros2_kafka_bridge.monitoring.sides import Sides
from ros2_kafka_bridge.monitoring.state import Watch

STATIC: Final = Path(__file__).parent / 'static'
_TICK_S: Final = 0.5


class Page(NamedTuple):
    """What the server shows.

    Args:
        watch: Knows the bridge.
        sides: Knows Kafka and the ROS graph.
        replay: Runs replays of dead letters.
        names: Tells what may stand in `Host`.
        stopping: Whether the server is to end.
        failed: Told when what draws the page has met a bug.
        log: Where is said what others do to it; its sums are said as long as it is shown.
    """

    watch: Watch
    sides: Sides
    replay: ReplayRunner
    names: Callable[[], Names]
    stopping: Callable[[], bool]
    failed: Callable[[], None]
    log: RouteLog


def make_app(page: Page) -> Starlette:
    """All of it as an ASGI application."""
    orders = Orders(page.watch, page.replay, page.log)
    desk = _Desk(page)
    routes = [
        Route('/', desk.index),
        Route('/metrics', desk.metrics),
        Route('/livez', desk.livez),
        Route('/readyz', desk.readyz),
        Route('/api/state', desk.state),
        Route('/api/history', desk.history),
        Route('/api/graph', desk.graph),
        Route('/api/events', desk.events, methods=['GET']),
        *orders.routes,
        Mount('/static', GZipMiddleware(StaticFiles(directory=STATIC), minimum_size=500)),
    ]
    around = [Middleware(Failures, log=page.log), Middleware(Guard, names=page.names)]
    missing = {HTTPStatus.NOT_FOUND: _missing, HTTPStatus.METHOD_NOT_ALLOWED: _missing}
    return Starlette(
        routes=routes,
        middleware=around,
        lifespan=desk.lifespan,
        exception_handlers={int(status): handler for status, handler in missing.items()},
    )


async def _missing(_request: Request, error: Exception) -> Response:
    status = getattr(error, 'status_code', HTTPStatus.NOT_FOUND)
    text = {404: 'there is nothing here', 405: 'not in this way'}.get(status, str(error))
    headers = {'allow': _ways(error)} if status == HTTPStatus.METHOD_NOT_ALLOWED else {}
    return JSONResponse({'error': text}, status, headers)


def _ways(error: Exception) -> str:
    """The methods that a path knows; that of a file does not say its own."""
    told = (getattr(error, 'headers', None) or {}).get('Allow', 'GET, HEAD')
    return ', '.join(sorted(told.split(', ')))


class _Desk:
    """Answers what only looks."""

    def __init__(self, page: Page) -> None:
        self._watch = page.watch
        self._log = page.log
        self._sides = page.sides
        self._replay = page.replay
        self._failed = page.failed
        self._board = Board()
        self._registry = CollectorRegistry()
        self._registry.register(BridgeCollector(page.watch))
        self.events = Events(self._board, page.stopping)

    @contextlib.asynccontextmanager
    async def lifespan(self, _app: Starlette) -> AsyncIterator[None]:
        ticking = asyncio.create_task(self._tick())
        try:
            yield
        finally:
            ticking.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await ticking
            self._log.close()

    async def _tick(self) -> None:
        """Keep the board as the last report has it, as long as somebody looks."""
        try:
            while True:
                self._log.tick()
                if self.events.browsers:
                    await run_in_threadpool(self._show)
                else:
                    self._board.clear()
                await asyncio.sleep(_TICK_S)
        except Exception:
            self._failed()  # else the page would stand still for ever
            raise

    def _show(self) -> None:
        for name, content in self._state().items():
            self._board.put(name, content)

    async def index(self, _request: Request) -> Response:
        return FileResponse(STATIC / 'index.html')

    async def metrics(self, request: Request) -> Response:
        return await run_in_threadpool(self._metrics, request)

    def _metrics(self, request: Request) -> Response:
        encode, kind = _encoder(request.headers.get('accept', ''))
        names = request.query_params.getlist('name[]')
        registry: Any = self._registry.restricted_registry(names) if names else self._registry
        data, headers = encode(registry), {'vary': 'Accept, Accept-Encoding'}
        if 'gzip' in request.headers.get('accept-encoding', ''):
            data, headers['content-encoding'] = gzip.compress(data, 1), 'gzip'
        return Response(data, headers=headers | {'content-type': kind})

    async def livez(self, request: Request) -> Response:
        return _told(request, liveness(self._watch.report(), self._watch.report_age_s))

    async def readyz(self, request: Request) -> Response:
        names = [route.name for route in self._watch.routes]
        report, age_s = self._watch.report(), self._watch.report_age_s
        return _told(request, readiness(report, age_s, names))

    async def state(self, _request: Request) -> Response:
        return _json(await run_in_threadpool(self._state))

    def _state(self) -> dict[str, Any]:
        replay = {'replay': self._replay.state()}
        return view.sections(self._watch) | self._sides.sections() | replay

    async def history(self, _request: Request) -> Response:
        sparks = await run_in_threadpool(view.sparks, self._watch)
        return _json({'step_s': BUCKET_S, 'span_s': SPAN_S, 'routes': sparks})

    async def graph(self, _request: Request) -> Response:
        return _json(await run_in_threadpool(self._sides.graph))


def _encoder(accept: str) -> tuple[Callable[[Any], bytes], str]:
    """In which of its formats Prometheus is answered: in the plain one whoever asks oddly."""
    try:
        return choose_encoder(accept)
    except Exception:  # noqa: BLE001 (of the library, about what somebody has sent)
        return choose_encoder('')


def _json(content: Any) -> Response:
    return Response(msgspec.json.encode(content), media_type='application/json')


def _told(request: Request, health: Health) -> Response:
    status = HTTPStatus.OK if health.good else HTTPStatus.SERVICE_UNAVAILABLE
    if 'application/json' in request.headers.get('accept', ''):
        return Response(json.dumps(health.as_dict()), status, media_type='application/json')
    return PlainTextResponse(health.text(verbose='verbose' in request.query_params), status)
