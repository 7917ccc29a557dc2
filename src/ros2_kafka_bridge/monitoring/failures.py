"""What a request meets that nobody has thought of: an answer, and a line that is summed."""

import traceback
from http import HTTPStatus
from pathlib import Path

from starlette.requests import ClientDisconnect
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ros2_kafka_bridge.errors import fault_of
from ros2_kafka_bridge.logs.summed import Summed
from ros2_kafka_bridge.logs.text import printable

_LONGEST_PATH = 100
_FRAMES = 5


class Failures:
    """Answers 500 where a request has met a bug, and says so in a line that is summed.

    Left to the server each would be a traceback, also of a page that another site has made ask.

    Args:
        app: What answers.
        said: The log, where it is said.
    """

    def __init__(self, app: ASGIApp, said: Summed) -> None:
        self._app = app
        self._said = said

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:  # noqa: D102
        begun = False

        async def send_noting(message: Message) -> None:
            nonlocal begun
            begun = begun or message['type'] == 'http.response.start'
            await send(message)

        try:
            await self._app(scope, receive, send_noting)
        except ClientDisconnect:
            return  # nobody waits for an answer
        except (Exception, SystemExit) as error:
            if scope['type'] != 'http':
                raise
            what = printable(f'{scope["method"]} {scope["path"]}'[:_LONGEST_PATH])
            self._said.error(
                f'the page could not answer {what}: {fault_of(error)}, by way of {_way(error)}: '
                'a bug of the bridge, report it',
                kind='not answered',
            )
            if not begun:
                told = {'error': 'a bug of the bridge: its log says more'}
                response = JSONResponse(told, HTTPStatus.INTERNAL_SERVER_ERROR)
                await response(scope, receive, send)


def _way(error: BaseException) -> str:
    """The last calls on the way to an error: a traceback on one line."""
    frames = traceback.extract_tb(error.__traceback__)[-_FRAMES:]
    return ' > '.join(f'{Path(frame.filename).name}:{frame.lineno}' for frame in frames)
