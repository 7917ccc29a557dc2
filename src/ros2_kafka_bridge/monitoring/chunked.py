"""Large answers in chunks, so that none waits whole in memory for whoever takes it slowly."""

from typing import Final

from starlette.types import ASGIApp, Message, Receive, Scope, Send

CHUNK_BYTES: Final = 64 * 1024


class Chunked:
    """Hands on what is sent in chunks: the server waits before each until the last has gone.

    Args:
        app: What answers.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:  # noqa: D102
        async def send_in_chunks(message: Message) -> None:
            body = message.get('body', b'')
            if message['type'] != 'http.response.body' or len(body) <= CHUNK_BYTES:
                await send(message)
                return
            last = len(body) - CHUNK_BYTES
            for start in range(0, len(body), CHUNK_BYTES):
                more = start < last or message.get('more_body', False)
                chunk = body[start : start + CHUNK_BYTES]
                await send({**message, 'body': chunk, 'more_body': more})

        await self._app(scope, receive, send_in_chunks)
