"""What a browser, Prometheus and Kubernetes may ask for."""

import asyncio
import contextlib
import gzip
import json
from collections.abc import AsyncIterator, Callable
from functools import partial
from http import HTTPStatus
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
from prometheus_client.exposition import choose_encoder, generate_latest
from prometheus_client.openmetrics import exposition as openmetrics
from prometheus_client.registry import CollectorRegistry
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Route

from ros2_kafka_bridge.logs.lines import RouteLog
from ros2_kafka_bridge.logs.summed import Summed
from ros2_kafka_bridge.monitoring import view
from ros2_kafka_bridge.monitoring.actions import Orders
from ros2_kafka_bridge.monitoring.board import Board
from ros2_kafka_bridge.monitoring.chunked import Chunked
from ros2_kafka_bridge.monitoring.failures import Failures
from ros2_kafka_bridge.monitoring.health import Health, liveness, readiness
from ros2_kafka_bridge.monitoring.history import BUCKET_S, SPAN_S
from ros2_kafka_bridge.monitoring.prometheus import BridgeCollector
from ros2_kafka_bridge.monitoring.replay import ReplayRunner
from ros2_kafka_bridge.monitoring.rights import Rights
from ros2_kafka_bridge.monitoring.shared_cache import SharedCache
from ros2_kafka_bridge.monitoring.sides import Sides
from ros2_kafka_bridge.monitoring.state import Watch
from ros2_kafka_bridge.web.events import Events
from ros2_kafka_bridge.web.files import file_routes
from ros2_kafka_bridge.web.guard import Guard, Names

STATIC: Final = Path(__file__).parent / 'static'
_OPEN_PATHS: Final = frozenset({'/metrics', '/livez', '/readyz'})
_CURE: Final = 'add that name to monitoring.allowed_hosts'
_TICK_S: Final = 0.5
_LOOK_S: Final = 0.2
_KEPT_S: Final = 0.5
_MOST_NAMES: Final = 100


class Page(NamedTuple):
    """What the server shows.

    Args:
        watch: Knows the bridge.
        sides: Knows Kafka and the ROS graph.
        replay: Runs replays of dead letters.
        names: Tells what may stand in `Host`.
        stopping: Whether the server is to end.
        failed: Told when what draws the page has met a bug.
        log: Where is said what was asked for; its sums are said as long as it is shown.
        said: Of that log, what anybody can have said.
    """

    watch: Watch
    sides: Sides
    replay: ReplayRunner
    names: Callable[[], Names]
    stopping: Callable[[], bool]
    failed: Callable[[], None]
    log: RouteLog
    said: Summed


def make_app(page: Page) -> Starlette:
    """All of it as an ASGI application."""
    rights = Rights(page.watch, page.said)
    orders = Orders(page.watch, page.replay, rights, page.log)
    desk = _Desk(page, rights)
    routes = [
        *file_routes(STATIC),
        Route('/metrics', desk.metrics),
        Route('/livez', desk.livez),
        Route('/readyz', desk.readyz),
        Route('/api/state', desk.state),
        Route('/api/history', desk.history),
        Route('/api/graph', desk.graph),
        Route('/api/events', desk.events, methods=['GET']),
        *orders.routes,
    ]
    around = [
        Middleware(Chunked),
        Middleware(Failures, said=page.said),
        Middleware(Guard, names=page.names, cure=_CURE, open_paths=_OPEN_PATHS, has_token=True),
    ]
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

    def __init__(self, page: Page, rights: Rights) -> None:
        self._watch = page.watch
        self._log = page.log
        self._sides = page.sides
        self._replay = page.replay
        self._failed = page.failed
        self._board = Board()
        self._registry = CollectorRegistry()
        self._registry.register(BridgeCollector(page.watch))
        self.events = Events(
            self._board.newer, page.stopping, 'bridge', _LOOK_S, rights.reject_wrong_token,
            page.said,
        )  # fmt: skip
        self._views = SharedCache[bytes](_KEPT_S)
        self._metrics = SharedCache[_Exposition](_KEPT_S)
        self._named = SharedCache[_Exposition](_KEPT_S)  # apart: there are many different ones

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

    def _version(self) -> object:
        """What an answer is made of, but for the time."""
        return self._watch.report(), self._watch.configured

    async def metrics(self, request: Request) -> Response:
        names = frozenset(request.query_params.getlist('name[]'))
        if len(names) > _MOST_NAMES:
            text = f'more than {_MOST_NAMES} names: leave name[] out for all metrics'
            return JSONResponse({'error': text}, HTTPStatus.BAD_REQUEST)
        encode, kind = _encoder(request.headers.get('accept', ''))
        kept = self._named if names else self._metrics
        make = partial(run_in_threadpool, self._exposition, encode, names)
        found = await kept.get((encode, names), make, self._version)
        data, headers = found.plain, {'vary': 'Accept, Accept-Encoding', 'content-type': kind}
        if 'gzip' in request.headers.get('accept-encoding', ''):
            data, headers['content-encoding'] = found.packed, 'gzip'
        return Response(data, headers=headers)

    def _exposition(self, encode: Callable[[Any], bytes], names: frozenset[str]) -> '_Exposition':
        registry: Any = self._registry.restricted_registry(names) if names else self._registry
        plain = encode(registry)
        return _Exposition(plain, gzip.compress(plain, 1))

    async def livez(self, request: Request) -> Response:
        return _told(request, liveness(self._watch.report(), self._watch.report_age_s))

    async def readyz(self, request: Request) -> Response:
        names = [route.name for route in self._watch.routes]
        report, age_s = self._watch.report(), self._watch.report_age_s
        return _told(request, readiness(report, age_s, names))

    async def state(self, _request: Request) -> Response:
        return await self._json('state', self._state, self._replay.state())

    async def _json(self, name: str, look: Callable[[], Any], *also: object) -> Response:
        make = partial(run_in_threadpool, lambda: msgspec.json.encode(look()))
        found = await self._views.get(name, make, lambda: (self._version(), also))
        return Response(found, media_type='application/json')

    def _state(self) -> dict[str, Any]:
        replay = {'replay': self._replay.state()}
        return view.sections(self._watch) | self._sides.sections() | replay

    async def history(self, _request: Request) -> Response:
        return await self._json('history', self._sparks)

    def _sparks(self) -> dict[str, Any]:
        sparks = view.sparks(self._watch)
        return {'step_s': BUCKET_S, 'span_s': SPAN_S, 'routes': sparks}

    async def graph(self, _request: Request) -> Response:
        return await self._json('graph', self._sides.graph)


class _Exposition(NamedTuple):
    """The metrics as they are sent."""

    plain: bytes
    packed: bytes


def _encoder(accept: str) -> tuple[Callable[[Any], bytes], str]:
    """In which of two formats Prometheus is answered: in the plain one whoever asks oddly.

    Whatever versions and ways of escaping are asked for, there are no more answers to be made.
    """
    try:
        _, kind = choose_encoder(accept)
    except Exception:  # noqa: BLE001 (of the library, about what somebody has sent)
        kind = ''
    if kind.startswith('application/openmetrics-text'):
        return openmetrics.generate_latest, openmetrics.CONTENT_TYPE_LATEST
    return generate_latest, choose_encoder('')[1]


def _told(request: Request, health: Health) -> Response:
    status = HTTPStatus.OK if health.good else HTTPStatus.SERVICE_UNAVAILABLE
    if 'application/json' in request.headers.get('accept', ''):
        return Response(json.dumps(health.as_dict()), status, media_type='application/json')
    return PlainTextResponse(health.text(verbose='verbose' in request.query_params), status)
