"""What a browser may ask to be done, and the letters that it may look into."""

import asyncio
from collections.abc import Awaitable, Callable
from http import HTTPStatus
from typing import Annotated, Any, Final, TypeVar

import msgspec
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from ros2_kafka_bridge.config.settings import MonitoringSettings
from ros2_kafka_bridge.dead_letters.letter import LetterPlace
from ros2_kafka_bridge.errors import BridgeError
from ros2_kafka_bridge.logs.lines import RouteLog, summed
from ros2_kafka_bridge.logs.text import printable
from ros2_kafka_bridge.monitoring import letters
from ros2_kafka_bridge.monitoring.guard import (
    Refusal,
    is_of_own_user,
    without_json,
    without_right,
)
from ros2_kafka_bridge.monitoring.replay import ReplayRunner
from ros2_kafka_bridge.monitoring.replay_process import ReplayOrder
from ros2_kafka_bridge.monitoring.state import Watch
from ros2_kafka_bridge.protocol.monitor import Answer, Do

_MOST_BODY_BYTES: Final = 256 * 1024
_WRONG_TOKEN_S: Final = 0.5
_Form = TypeVar('_Form')


class ReloadForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Args: preview: Only tell what would change."""

    preview: bool


class ReplayForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """As `replay_process.Order`; `places` null means all."""

    topic: str
    dry_run: bool
    places: Annotated[tuple[str, ...], msgspec.Meta(min_length=1, max_length=5000)] | None = None
    to_ros: bool = False
    again: bool = False
    force: bool = False


class NothingForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An empty object."""


class Orders:
    """Answers what changes something.

    Args:
        watch: Knows the bridge, and passes on what is asked for.
        replay: Runs replays.
        log: Where is said who asked for what; it has the sum of wrong tokens.
    """

    def __init__(self, watch: Watch, replay: ReplayRunner, log: RouteLog) -> None:
        self._watch = watch
        self._replay = replay
        self._reading = asyncio.Semaphore(2)
        self._log = log
        self._wrong_tokens = summed(log)

    @property
    def routes(self) -> list[Route]:
        """Where each of them is asked for."""
        return [
            _post('/api/token', self._order(NothingForm, self._token)),
            _post('/api/routes/{name}/pause', self._pause(Do.PAUSE)),
            _post('/api/routes/{name}/resume', self._pause(Do.RESUME)),
            _post('/api/reload', self._order(ReloadForm, self._reload)),
            _post('/api/replay', self._order(ReplayForm, self._begin_replay)),
            _post('/api/replay/stop', self._order(NothingForm, self._end_replay)),
            Route('/api/dead-letters/{topic}', self._letters),
            Route('/api/dead-letters/{topic}/{partition:int}/{offset:int}', self._letter),
        ]

    def _order(
        self,
        form: type[_Form],
        act: Callable[[Request, _Form], Awaitable[Response]],
    ) -> Callable[[Request], Awaitable[Response]]:
        """Make the handler of something that only those with the token may ask for."""

        async def handle(request: Request) -> Response:
            refusal = without_json(request.headers) or await self._without_right(request)
            if refusal is not None:
                return _refused(refusal)
            body = bytearray()
            async for part in request.stream():
                body += part
                if len(body) > _MOST_BODY_BYTES:
                    text = f'the body is over {_MOST_BODY_BYTES // 1024} KiB'
                    return _refused(Refusal(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, text))
            try:
                asked = msgspec.json.decode(bytes(body) or b'{}', type=form)
            except msgspec.DecodeError as error:
                return _refused(Refusal(HTTPStatus.BAD_REQUEST, printable(str(error))))
            return await act(request, asked)

        return handle

    async def _without_right(self, request: Request) -> Refusal | None:
        given = request.headers.get('authorization', '')
        refusal = without_right(self._settings, given)
        if refusal is not None and given:
            self._wrong_tokens.warning(f'the page: a wrong token from {_who(request)}')
            await asyncio.sleep(_WRONG_TOKEN_S)  # who guesses, guesses slowly
        return refusal

    @property
    def _settings(self) -> MonitoringSettings:
        return self._watch.config.monitoring or MonitoringSettings()

    async def _token(self, _request: Request, _form: NothingForm) -> Response:
        return JSONResponse({'text': 'this is the token'})

    # Routes and configuration

    def _pause(self, do: Do) -> Callable[[Request], Awaitable[Response]]:
        async def act(request: Request, _form: NothingForm) -> Response:
            name = request.path_params['name']
            if name not in {route.name for route in self._watch.routes}:
                return _nothing(f'no route {printable(name)} here')
            self._say(request, f'{do} of {name}')
            return _answered(await run_in_threadpool(self._watch.ask, do, name))

        return self._order(NothingForm, act)

    def _say(self, request: Request, what: str) -> None:
        self._log.info('%s was asked for, by the page, from %s', what, _who(request))

    async def _reload(self, request: Request, form: ReloadForm) -> Response:
        do = Do.PREVIEW if form.preview else Do.RELOAD
        if not form.preview:
            self._say(request, do)
        return _answered(await run_in_threadpool(self._watch.ask, do))

    # Dead letters

    async def _begin_replay(self, _request: Request, form: ReplayForm) -> Response:
        if problem := self._replay_problem(form):
            return _refused(Refusal(HTTPStatus.BAD_REQUEST, problem))
        configured = self._watch.configured
        order = ReplayOrder(
            configured.values, form.topic, form.places,
            form.to_ros, form.dry_run, form.again, form.force,
        )  # fmt: skip
        if not await run_in_threadpool(self._replay.start, order):
            return _refused(Refusal(HTTPStatus.CONFLICT, 'a replay runs already: wait for it'))
        return JSONResponse(self._replay.state(), HTTPStatus.ACCEPTED)

    def _replay_problem(self, form: ReplayForm) -> str:
        if form.topic not in self._topics:
            return f'{printable(form.topic)} is no dead-letter topic of this bridge'
        if form.to_ros and form.force:
            return 'force goes with Kafka only: ROS would take garbage silently'
        for text in form.places or ():
            place = LetterPlace.parse(text)
            if place is None or place.topic != form.topic or not _can_be(place):
                return f'{printable(text)} is no letter of {form.topic}'
        return ''

    async def _end_replay(self, _request: Request, _form: NothingForm) -> Response:
        if self._replay.stop():
            return JSONResponse({'text': 'the replay ends after the batch in hand'})
        return _refused(Refusal(HTTPStatus.CONFLICT, 'no replay runs'))

    @property
    def _topics(self) -> set[str]:
        return {route.dead_letter_topic for route in self._watch.routes}

    async def _letters(self, request: Request) -> Response:
        topic = request.path_params['topic']
        if topic not in self._topics:
            return _nothing(f'{printable(topic)} is no dead-letter topic of this bridge')
        return await self._read(letters.newest, topic)

    async def _letter(self, request: Request) -> Response:
        """One letter with its content, which is not for everybody who may look at the page."""
        topic = request.path_params['topic']
        if topic not in self._topics:
            return _nothing(f'{printable(topic)} is no dead-letter topic of this bridge')
        if refusal := await self._kept_back(request):
            return _refused(refusal)
        place = LetterPlace(topic, request.path_params['partition'], request.path_params['offset'])
        if not _can_be(place):
            return _nothing(f'{place} is no letter')
        return await self._read(letters.look, place)

    async def _kept_back(self, request: Request) -> Refusal | None:
        if self._settings.token is not None:
            return await self._without_right(request)
        if await run_in_threadpool(is_of_own_user, request):
            return None
        text = "what messages hold is shown to others than the bridge's own user only with a token"
        return Refusal(HTTPStatus.FORBIDDEN, f'{text}: set monitoring.token')

    async def _read(self, read: Callable[..., Any], what: Any) -> Response:
        async with self._reading:
            try:
                found = await run_in_threadpool(read, self._watch.config, what)
            except BridgeError as error:
                text = printable(str(error))
                return _refused(Refusal(HTTPStatus.SERVICE_UNAVAILABLE, text))
        if found is None:
            return _nothing(f'{what} is no longer there')
        return Response(msgspec.json.encode(found), media_type='application/json')


def _who(request: Request) -> str:
    return printable(request.client.host) if request.client else 'somebody'


def _can_be(place: LetterPlace) -> bool:
    """Whether Kafka counts so far."""
    return place.partition < 2**31 and place.offset < 2**63 - 1


def _post(path: str, handle: Callable[[Request], Awaitable[Response]]) -> Route:
    return Route(path, handle, methods=['POST'])


def _answered(answer: Answer) -> Response:
    status = HTTPStatus.OK if answer.done else HTTPStatus.CONFLICT
    told = {'done': answer.done, 'text': answer.text, 'changes': list(answer.changes)}
    return JSONResponse(told if answer.done else {**told, 'error': answer.text}, status)


def _nothing(text: str) -> Response:
    return _refused(Refusal(HTTPStatus.NOT_FOUND, text))


def _refused(refusal: Refusal) -> Response:
    headers = {}
    if refusal.status is HTTPStatus.UNAUTHORIZED:
        headers['www-authenticate'] = 'Bearer'
    return JSONResponse({'error': refusal.text}, refusal.status, headers)
