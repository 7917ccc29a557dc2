"""Server-sent events: what has changed on the board, as often as a browser can take it.

A browser that is slow gets the newest state less often, never a queue of old ones. One that takes
nothing for half a minute is let go.
"""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus
from typing import Final

from starlette.responses import JSONResponse
from starlette.types import Message, Receive, Scope, Send

from ros2_kafka_bridge.monitoring.board import Board

MOST_BROWSERS: Final = 50
_LOOK_S: Final = 0.2
_ALIVE_S: Final = 15.0
_PATIENCE_S: Final = 30.0
_HEADERS: Final = (
    (b'content-type', b'text/event-stream; charset=utf-8'),
    (b'x-accel-buffering', b'no'),  # nginx sends it on at once
)
_START: Final[Message] = {
    'type': 'http.response.start', 'status': HTTPStatus.OK, 'headers': [*_HEADERS],
}  # fmt: skip
_END: Final[Message] = {'type': 'http.response.body', 'body': b'', 'more_body': False}


class Events:
    """The stream of changes, as an ASGI application.

    Args:
        board: What is shown.
        stopping: Whether the server is to end: the streams then end, too.
    """

    def __init__(
        self, board: Board, stopping: Callable[[], bool], patience_s: float = _PATIENCE_S
    ) -> None:
        self._board = board
        self._stopping = stopping
        self._patience_s = patience_s
        self.browsers = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:  # noqa: D102
        if scope['method'] == 'HEAD':
            await send(_START)
            await send(_END)
            return
        if self.browsers >= MOST_BROWSERS:
            text = f'{MOST_BROWSERS} browsers look at this page already: close some'
            full = JSONResponse({'error': text}, HTTPStatus.SERVICE_UNAVAILABLE)
            await full(scope, receive, send)
            return
        self.browsers += 1
        stream = asyncio.ensure_future(self._stream(send))
        gone = asyncio.ensure_future(_gone(receive))
        try:
            await asyncio.wait({stream, gone}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            self.browsers -= 1
            for task in (stream, gone):
                task.cancel()
                with suppress(asyncio.CancelledError, OSError, TimeoutError):
                    await task

    async def _stream(self, send: Send) -> None:
        await send(_START)
        await self._send(send, b'retry: 1000\n\n')
        seen: dict[str, int] = {}
        said_s = now_s = asyncio.get_running_loop().time()
        while not self._stopping():
            now_s = asyncio.get_running_loop().time()
            if changed := self._board.newer(seen):
                await self._send(send, b'data: %s\n\n' % changed)
                said_s = now_s
            elif now_s - said_s > _ALIVE_S:
                await self._send(send, b': still here\n\n')
                said_s = now_s
            await asyncio.sleep(_LOOK_S)
        await send(_END)

    async def _send(self, send: Send, data: bytes) -> None:
        message = {'type': 'http.response.body', 'body': data, 'more_body': True}
        await asyncio.wait_for(send(message), self._patience_s)


async def _gone(receive: Receive) -> None:
    while (await receive())['type'] != 'http.disconnect':
        pass
