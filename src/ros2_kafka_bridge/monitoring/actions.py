"""What a browser may ask to be done, and the letters that it may look into."""

import asyncio
import re
from collections.abc import Awaitable, Callable
from functools import partial
from http import HTTPStatus
from typing import Any, Final, NamedTuple, TypeVar

import msgspec
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.dead_letters.letter import LetterPlace
from ros2_kafka_bridge.errors import BridgeError
from ros2_kafka_bridge.logs.lines import RouteLog
from ros2_kafka_bridge.logs.text import printable
from ros2_kafka_bridge.monitoring import letters
from ros2_kafka_bridge.monitoring.replay import ReplayRunner
from ros2_kafka_bridge.monitoring.replay_process import ReplayForm, ReplayOrder
from ros2_kafka_bridge.monitoring.rights import Rights, is_of_own_user
from ros2_kafka_bridge.monitoring.shared_cache import SharedCache
from ros2_kafka_bridge.monitoring.state import Watch
from ros2_kafka_bridge.protocol.monitor import Answer, Do
from ros2_kafka_bridge.web.caller import has_shown_token, who
from ros2_kafka_bridge.web.guard import Refusal, read_body, refused, without_json

_MOST_BODY_BYTES: Final = 256 * 1024
_LETTERS_KEPT_S: Final = 3.0
_NUMBER: Final = re.compile(r'[0-9]{1,19}')
_Form = TypeVar('_Form')


class ReloadForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Args: preview: Only tell what would change."""

    preview: bool


class NothingForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An empty object."""


class _Found(NamedTuple):
    """What a look at Kafka has found, or why there was none."""

    status: HTTPStatus
    body: bytes


class Orders:
    """Answers what changes something, and what letters there are.

    Args:
        watch: Knows the bridge, and passes on what is asked for.
        replay: Runs replays.
        rights: Knows who shows the token.
        log: Where is said who asked for what.
    """

    def __init__(self, watch: Watch, replay: ReplayRunner, rights: Rights, log: RouteLog) -> None:
        self._watch = watch
        self._replay = replay
        self._rights = rights
        # Whoever shows the token does not stand in line behind all others.
        self._lists = {shown: SharedCache[_Found](_LETTERS_KEPT_S) for shown in (False, True)}
        self._looking = asyncio.Semaphore(1)
        self._log = log

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
            Route('/api/dead-letters/{topic}/{partition}/{offset}', self._letter),
        ]

    def _order(
        self,
        form: type[_Form],
        act: Callable[[Request, _Form], Awaitable[Response]],
    ) -> Callable[[Request], Awaitable[Response]]:
        """Make the handler of something that only those with the token may ask for."""

        async def handle(request: Request) -> Response:
            refusal = without_json(request.headers) or await self._rights.require_token(request)
            if refusal is not None:
                return refused(refusal)
            body = await read_body(request, _MOST_BODY_BYTES)
            if isinstance(body, Refusal):
                return refused(body)
            try:
                asked = msgspec.json.decode(body or b'{}', type=form)
            except msgspec.DecodeError as error:
                return refused(Refusal(HTTPStatus.BAD_REQUEST, printable(str(error))))
            return await act(request, asked)

        return handle

    async def _token(self, _request: Request, _form: NothingForm) -> Response:
        return JSONResponse({'text': 'this is the token'})

    # Routes and configuration

    def _pause(self, do: Do) -> Callable[[Request], Awaitable[Response]]:
        async def act(request: Request, _form: NothingForm) -> Response:
            name = request.path_params['name']
            if name not in {route.name for route in self._watch.routes}:
                return _nothing(f'no route {printable(name)} here')
            self._say(request, f'{do} of {name}')
            return _answered(await run_in_threadpool(self._watch.request, do, name))

        return self._order(NothingForm, act)

    def _say(self, request: Request, what: str) -> None:
        self._log.info('%s was asked for, by the page, from %s', what, who(request.client))

    async def _reload(self, request: Request, form: ReloadForm) -> Response:
        do = Do.PREVIEW if form.preview else Do.RELOAD
        if not form.preview:
            self._say(request, do)
        return _answered(await run_in_threadpool(self._watch.request, do))

    # Dead letters

    async def _begin_replay(self, _request: Request, form: ReplayForm) -> Response:
        if problem := self._replay_problem(form):
            return refused(Refusal(HTTPStatus.BAD_REQUEST, problem))
        order = ReplayOrder(self._watch.configured.values, form)
        if not await run_in_threadpool(self._replay.start, order):
            return refused(Refusal(HTTPStatus.CONFLICT, 'a replay runs already: wait for it'))
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
        return refused(Refusal(HTTPStatus.CONFLICT, 'no replay runs'))

    @property
    def _topics(self) -> set[str]:
        return {route.dead_letter_topic for route in self._watch.routes}

    async def _letters(self, request: Request) -> Response:
        topic = request.path_params['topic']
        if topic not in self._topics:
            return _nothing(f'{printable(topic)} is no dead-letter topic of this bridge')
        if refusal := await self._rights.reject_wrong_token(request):
            return refused(refusal)
        make = partial(self._look_at_kafka, letters.newest, topic)
        found = await self._lists[has_shown_token(request.scope)].get(topic, make, self._version)
        return Response(found.body, found.status, media_type='application/json')

    def _version(self) -> object:
        """What a list of letters depends on, but for Kafka."""
        replay = self._replay.state() or {}
        return self._watch.configured, replay.get('number'), replay.get('status')

    async def _letter(self, request: Request) -> Response:
        """One letter with its content, which is not for everybody who may look at the page."""
        topic = request.path_params['topic']
        if topic not in self._topics:
            return _nothing(f'{printable(topic)} is no dead-letter topic of this bridge')
        if refusal := await self._kept_back(request):
            return refused(refusal)
        numbers = request.path_params['partition'], request.path_params['offset']
        if not all(map(_NUMBER.fullmatch, numbers)):
            return _nothing('these are no numbers of a letter')
        place = LetterPlace(topic, *map(int, numbers))
        if not _can_be(place):
            return _nothing(f'{place} is no letter')
        async with self._looking:
            found = await self._look_at_kafka(letters.look, place)
        return Response(found.body, found.status, media_type='application/json')

    async def _kept_back(self, request: Request) -> Refusal | None:
        if self._rights.settings.token is not None:
            return await self._rights.require_token(request)
        if await run_in_threadpool(is_of_own_user, request):
            return None
        text = "what messages hold is shown to others than the bridge's own user only with a token"
        return Refusal(HTTPStatus.FORBIDDEN, f'{text}: set monitoring.token')

    async def _look_at_kafka(self, read: Callable[..., Any], what: Any) -> _Found:
        try:
            return await run_in_threadpool(_read, read, self._watch.config, what)
        except BridgeError as error:
            told = {'error': printable(str(error))}
            return _Found(HTTPStatus.SERVICE_UNAVAILABLE, msgspec.json.encode(told))


def _read(read: Callable[..., Any], config: Config, what: Any) -> _Found:
    found = read(config, what)
    if found is None:
        told = {'error': f'{what} is no longer there'}
        return _Found(HTTPStatus.NOT_FOUND, msgspec.json.encode(told))
    return _Found(HTTPStatus.OK, msgspec.json.encode(found))


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
    return refused(Refusal(HTTPStatus.NOT_FOUND, text))
