"""Connections that ask for nothing, or never to the end."""

import asyncio
from typing import Final

import uvicorn
from starlette.types import Receive, Scope, Send
from uvicorn.server import ServerState

from ros2_kafka_bridge.monitoring.server import Connection

_PATIENCE_S: Final = 0.2
_ASKED: Final = b'GET / HTTP/1.1\r\nhost: x\r\n'


class _Hurried(Connection):
    patience_s = _PATIENCE_S


async def _slow(_scope: Scope, _receive: Receive, send: Send) -> None:
    """Answer for longer than anybody may be silent."""
    await send({'type': 'http.response.start', 'status': 200, 'headers': []})
    for _ in range(10):
        await send({'type': 'http.response.body', 'body': b'x', 'more_body': True})
        await asyncio.sleep(_PATIENCE_S / 2)
    await send({'type': 'http.response.body', 'body': b'end', 'more_body': False})


def test_who_asks_for_nothing_is_let_go_and_who_is_answered_is_not() -> None:
    async def talk(port: int, said: bytes, more: bytes = b'') -> bytes:
        reader, writer = await asyncio.open_connection('127.0.0.1', port)
        writer.write(said)
        reading = asyncio.create_task(reader.read())
        while more and not reading.done():
            writer.write(more)  # a byte now and then never ends it
            await asyncio.sleep(_PATIENCE_S / 4)
        got = await reading
        writer.close()
        return got

    async def run() -> tuple[bytes, bytes, bytes]:
        config = uvicorn.Config(_slow, http=_Hurried, log_config=None, lifespan='off', ws='none')
        config.load()
        state = ServerState()
        loop = asyncio.get_running_loop()
        server = await loop.create_server(lambda: _Hurried(config, state, {}), '127.0.0.1', 0)
        port = server.sockets[0].getsockname()[1]
        async with asyncio.timeout(30):
            found = await asyncio.gather(
                talk(port, b''), talk(port, _ASKED, b'a'), talk(port, _ASKED + b'\r\n')
            )
        server.close()
        assert not state.connections
        return found

    silent, endless, answered = asyncio.run(run())
    assert silent == b''
    assert endless == b''
    assert answered.startswith(b'HTTP/1.1 200')
    assert b'end' in answered
