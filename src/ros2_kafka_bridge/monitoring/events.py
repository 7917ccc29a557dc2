"""Server-sent events: what has changed on the board, as often as a browser can take it.

A browser that is slow gets the newest state less often, never a queue of old ones. Where there
are too many, one is let go, is told so, and is not to come back at once: they would throw each
other out in turn for ever.
"""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus
from typing import Final

import msgspec
from starlette.requests import Request
from starlette.types import Message, Receive, Scope, Send

from ros2_kafka_bridge.logs.summed import Summed
from ros2_kafka_bridge.monitoring.board import Board
from ros2_kafka_bridge.monitoring.caller import network_of, who
from ros2_kafka_bridge.monitoring.guard import refused
from ros2_kafka_bridge.monitoring.rights import Rights, has_shown_token
from ros2_kafka_bridge.monitoring.viewers import Viewer, Viewers

_LOOK_S: Final = 0.2
_ALIVE_S: Final = 15.0
_HEADERS: Final = (
    (b'content-type', b'text/event-stream; charset=utf-8'),
    (b'x-accel-buffering', b'no'),  # nginx sends it on at once
)
_START: Final[Message] = {
    'type': 'http.response.start', 'status': HTTPStatus.OK, 'headers': [*_HEADERS],
}  # fmt: skip
_FULL: Final = (
    'Too many pages look at this bridge: one that has looked for longest is let go, and this was '
    'it.'
)
_LET_GO: Final = b'event: full\nretry: 30000\ndata: %s\n\n' % msgspec.json.encode({'error': _FULL})
_END: Final[Message] = {'type': 'http.response.body', 'body': b'', 'more_body': False}


class Events:
    """The stream of changes, as an ASGI application.

    Args:
        board: What is shown.
        stopping: Whether the server is to end: the streams then end, too.
        rights: Knows who shows the token: those have places of their own.
        said: The log, which is told that there are too many.
    """

    def __init__(
        self, board: Board, stopping: Callable[[], bool], rights: Rights, said: Summed
    ) -> None:
        self._board = board
        self._stopping = stopping
        self._rights = rights
        self._said = said
        self._viewers = Viewers()

    @property
    def browsers(self) -> int:
        """How many look."""
        return len(self._viewers)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:  # noqa: D102
        if scope['method'] == 'HEAD':
            await send(_START)
            await send(_END)
            return
        request = Request(scope)
        if refusal := await self._rights.reject_wrong_token(request):
            await refused(refusal)(scope, receive, send)
            return
        viewer = self._enter(request)
        stream = asyncio.ensure_future(self._stream(send, viewer))
        gone = asyncio.ensure_future(_gone(receive))
        try:
            await asyncio.wait({stream, gone}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._viewers.leave(viewer)
            for task in (stream, gone):
                task.cancel()
                with suppress(asyncio.CancelledError, OSError):
                    await task

    def _enter(self, request: Request) -> Viewer:
        has_token = has_shown_token(request.scope)
        viewer = Viewer(network_of(request.client), has_token=has_token)
        if self._viewers.enter(viewer):
            text = 'the page: too many browsers at once: one that has looked for longest is let go'
            self._said.warning(text, f'; the newest is from {who(request.client)}', kind='pages')
        return viewer

    async def _stream(self, send: Send, viewer: Viewer) -> None:
        await send(_START)
        await _send(send, b'retry: 1000\n\n')
        seen: dict[str, int] = {}
        said_s = now_s = asyncio.get_running_loop().time()
        while not self._stopping() and not viewer.is_let_go:
            now_s = asyncio.get_running_loop().time()
            if changed := self._board.newer(seen):
                await _send(send, b'data: %s\n\n' % changed)
                said_s = now_s
            elif now_s - said_s > _ALIVE_S:
                await _send(send, b': still here\n\n')
                said_s = now_s
            await asyncio.sleep(_LOOK_S)
        if viewer.is_let_go:
            await _send(send, _LET_GO)
        await send(_END)


async def _send(send: Send, data: bytes) -> None:
    await send({'type': 'http.response.body', 'body': data, 'more_body': True})


async def _gone(receive: Receive) -> None:
    while (await receive())['type'] != 'http.disconnect':
        pass
