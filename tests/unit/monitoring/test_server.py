"""Connections that ask for nothing, or never to the end, and too many of them."""

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from typing import Final

import pytest
import uvicorn
from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.server import ServerState

from ros2_kafka_bridge.logs.lines import route_log, summed
from ros2_kafka_bridge.monitoring.chunked import CHUNK_BYTES, Chunked
from ros2_kafka_bridge.monitoring.server import Connection

from .sites import until

_PATIENCE_S: Final = 0.2
_ASKED: Final = b'GET / HTTP/1.1\r\nhost: x\r\n'
_LAST: Final = b'connection: close\r\n\r\n'
_SLOW: Final = _ASKED.replace(b'/ ', b'/slow ') + _LAST


class _Hurried(Connection):
    patience_s = _PATIENCE_S
    stalled_s = _PATIENCE_S


@asynccontextmanager
async def _served(app: ASGIApp, kind: type[Connection], most: int) -> AsyncIterator[int]:
    """The port of a server with such connections; none is left behind."""
    config = uvicorn.Config(app, http=kind, log_config=None, lifespan='off', ws='none')
    config.load()
    state, said = ServerState(), summed(route_log(), first=1)
    loop = asyncio.get_running_loop()

    def connect() -> Connection:
        return kind(said, most, config=config, server_state=state, app_state={})

    server = await loop.create_server(connect, '127.0.0.1', 0)
    async with asyncio.timeout(30):
        yield server.sockets[0].getsockname()[1]
        server.close()
        while state.connections:  # noqa: ASYNC110 (nothing tells it)
            await asyncio.sleep(0.01)


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
        try:
            got = await reading
        except ConnectionResetError:  # where a byte had come that was not read
            got = b''
        writer.close()
        return got

    async def run() -> tuple[bytes, bytes, bytes]:
        async with _served(_slow, _Hurried, 500) as port:
            return await asyncio.gather(
                talk(port, b''), talk(port, _ASKED, b'a'), talk(port, _ASKED + b'\r\n')
            )

    silent, endless, answered = asyncio.run(run())
    assert silent == b''
    assert endless == b''
    assert answered.startswith(b'HTTP/1.1 200')
    assert b'end' in answered


async def _at_once(_scope: Scope, _receive: Receive, send: Send) -> None:
    await send({'type': 'http.response.start', 'status': 200, 'headers': []})
    await send({'type': 'http.response.body', 'body': b'ok'})


async def _mixed(scope: Scope, receive: Receive, send: Send) -> None:
    await (_slow if scope['path'] == '/slow' else _at_once)(scope, receive, send)


def test_who_has_been_idle_for_longest_makes_room_for_the_newest(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    logger = logging.getLogger('ros2_kafka_bridge')
    monkeypatch.setattr(logger, 'handlers', [caplog.handler])
    monkeypatch.setattr(logger, 'propagate', False)

    async def run() -> None:
        async with _served(_mixed, _Settled, 4) as port:
            ends = [await asyncio.open_connection('127.0.0.1', port) for _ in range(4)]
            (slow, ask_slow), (kept, ask_kept), (first, _), (second, _) = ends
            ask_slow.write(_SLOW)
            assert b'200' in await slow.readline()
            ask_kept.write(_ASKED + b'\r\n')
            assert b'200' in await kept.readline()
            for idle in (first, second, kept):  # in the order in which they have fallen silent
                probe, ask = await asyncio.open_connection('127.0.0.1', port)
                ask.write(_ASKED + _LAST)
                assert b'200' in await probe.readline()
                ask.close()
                await _is_let_go(idle)
                ends.append(await asyncio.open_connection('127.0.0.1', port))
            assert (await slow.read()).endswith(b'end\r\n0\r\n\r\n')
            for _, end in ends:
                end.close()

    asyncio.run(run())
    text = 'the page: 4 connections at once: one of the client that has most is let go'
    assert caplog.messages == [f'{text}; the newest is from 127.0.0.1']


class _Settled(Connection):
    """One that counts as idle as soon as it is."""

    new_s = 0.0


class _Young(Connection):
    """One that has always come just now, however busy the machine."""

    new_s = 60.0


async def _is_let_go(reader: asyncio.StreamReader) -> None:
    with suppress(ConnectionResetError):
        await reader.read()


def test_where_all_are_being_answered_the_newest_still_gets_in() -> None:
    async def forever(_scope: Scope, receive: Receive, send: Send) -> None:
        if _scope['path'] == '/slow':
            await receive()
            await receive()  # until it is gone
            return
        await _at_once(_scope, receive, send)

    async def run() -> bytes:
        async with _served(forever, Connection, 3) as port:
            ends = [await asyncio.open_connection('127.0.0.1', port) for _ in range(3)]
            for _, asking in ends:
                asking.write(_SLOW)
            await asyncio.sleep(_PATIENCE_S)
            probe, ask = await asyncio.open_connection('127.0.0.1', port)
            ask.write(_ASKED + b'\r\n')
            said = await probe.readline()
            for _, end in [*ends, (probe, ask)]:
                end.close()
            return said

    assert asyncio.run(run()).startswith(b'HTTP/1.1 200')


def test_who_has_just_come_among_others_that_are_answered_may_ask_before_it_counts_as_idle() -> (
    None
):
    async def run() -> bytes:
        async with _served(_mixed, _Young, 3) as port:
            ends = [await asyncio.open_connection('127.0.0.1', port) for _ in range(3)]
            for reader, asking in ends:
                asking.write(_SLOW)
                await reader.readline()
            probe, ask = await asyncio.open_connection('127.0.0.1', port)
            ends.append(await asyncio.open_connection('127.0.0.1', port))
            ask.write(_ASKED + _LAST)
            said = await probe.readline()
            for _, end in [*ends, (probe, ask)]:
                end.close()
            return said

    assert asyncio.run(run()).startswith(b'HTTP/1.1 200')


def test_who_takes_nothing_of_a_large_answer_is_let_go_and_holds_little_of_it() -> None:
    held: list[int] = []

    async def large(_scope: Scope, _receive: Receive, send: Send) -> None:
        await send({'type': 'http.response.start', 'status': 200, 'headers': []})
        await send({'type': 'http.response.body', 'body': b'x' * 64 * 1024 * 1024})

    class Looked(_Hurried):
        def pause_writing(self) -> None:
            super().pause_writing()
            held.append(self.transport.get_write_buffer_size())

    async def run() -> None:
        async with _served(Chunked(large), Looked, 500) as port:
            reader, asking = await asyncio.open_connection('127.0.0.1', port)
            reader._transport.pause_reading()  # type: ignore[attr-defined]  # nothing else does it
            asking.write(_ASKED + _LAST)
            await until(lambda: bool(held))
        assert max(held) <= 4 * CHUNK_BYTES  # the server has let it go, else this would not end
        asking.close()

    asyncio.run(run())


@pytest.mark.parametrize('many', [b'', _SLOW])
def test_who_has_most_connections_makes_room_and_not_the_operator(many: bytes) -> None:
    """The operator has been answered for longest of all, which alone would end it."""

    class Asked(Connection):
        def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
            first = not any(self.connections)
            super().connection_made(transport)
            self.network = 'operator' if first else 'stranger'

    async def run() -> bytes:
        async with _served(_until_told, Asked, 5) as port:
            operator, asking = await asyncio.open_connection('127.0.0.1', port)
            asking.write(_SLOW)
            await operator.readline()
            ends = [asking]
            for _ in range(12):
                _, writer = await asyncio.open_connection('127.0.0.1', port)
                writer.write(many)
                await asyncio.sleep(0.01)
                ends.append(writer)
            probe, ask = await asyncio.open_connection('127.0.0.1', port)
            ask.write(_ASKED + _LAST)
            assert b'200' in await probe.readline()
            told.set()
            found = await operator.read()
            for end in [*ends, ask]:
                end.close()
            return found

    told = asyncio.Event()

    async def _until_told(scope: Scope, _receive: Receive, send: Send) -> None:
        await send({'type': 'http.response.start', 'status': 200, 'headers': []})
        if scope['path'] == '/slow':
            await told.wait()
        await send({'type': 'http.response.body', 'body': b'told'})

    assert b'told' in asyncio.run(run())
