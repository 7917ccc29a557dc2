"""Server-sent events: what has changed of what is shown, as often as a browser can take it.

A browser that is slow gets the newest state less often, never a queue of old ones. Where there
are too many, one is let go, is told so, and is not to come back at once: they would throw each
other out in turn for ever.
"""

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from http import HTTPStatus
from typing import Final

import msgspec
from starlette.requests import Request
from starlette.types import Message, Receive, Scope, Send

from ros2_kafka_bridge.logs.summed import Summed
from ros2_kafka_bridge.web.caller import has_shown_token, network_of, who
from ros2_kafka_bridge.web.guard import Refusal, refused
from ros2_kafka_bridge.web.viewers import Viewer, Viewers

_ALIVE_S: Final = 15.0
_HEADERS: Final = (
    (b'content-type', b'text/event-stream; charset=utf-8'),
    (b'x-accel-buffering', b'no'),  # nginx sends it on at once
)
_START: Final[Message] = {
    'type': 'http.response.start', 'status': HTTPStatus.OK, 'headers': [*_HEADERS],
}  # fmt: skip
_FULL: Final = (
    'Too many pages look at this {}: one that has looked for longest is let go, and this was it.'
)
_END: Final[Message] = {'type': 'http.response.body', 'body': b'', 'more_body': False}


class Events:
    """The stream of changes, as an ASGI application.

    Who has shown a token has a place beside all others.

    Args:
        newer: A JSON object of the sections that have changed since, b'' for none; it brings up
            to date which change of each was seen last.
        stopping: Whether the server is to end: the streams then end, too.
        shown: What is shown, in a word.
        look_s: How often is looked for changes.
        reject: Tells why somebody may not look; None lets everybody look.
        said: The log, which is told that there are too many.
    """

    def __init__(
        self,
        newer: Callable[[dict[str, int]], bytes],
        stopping: Callable[[], bool],
        shown: str,
        look_s: float,
        reject: Callable[[Request], Awaitable[Refusal | None]] | None = None,
        said: Summed | None = None,
    ) -> None:
        self._newer = newer
        self._stopping = stopping
        told = msgspec.json.encode({'error': _FULL.format(shown)})
        self._let_go = b'event: full\nretry: 30000\ndata: %s\n\n' % told
        self._look_s = look_s
        self._reject = reject
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
        if self._reject is not None and (refusal := await self._reject(request)):
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
        if self._viewers.enter(viewer) and self._said is not None:
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
            if changed := self._newer(seen):
                await _send(send, b'data: %s\n\n' % changed)
                said_s = now_s
            elif now_s - said_s > _ALIVE_S:
                await _send(send, b': still here\n\n')
                said_s = now_s
            await asyncio.sleep(self._look_s)
        if viewer.is_let_go:
            await _send(send, self._let_go)
        await send(_END)


async def _send(send: Send, data: bytes) -> None:
    await send({'type': 'http.response.body', 'body': data, 'more_body': True})


async def _gone(receive: Receive) -> None:
    while (await receive())['type'] != 'http.disconnect':
        pass
