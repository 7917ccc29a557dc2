"""Who shows the token, who shows a wrong one, and who needs none."""

import asyncio
import hmac
import os
from http import HTTPStatus
from typing import Final

from starlette.requests import Request

from ros2_kafka_bridge.config.monitoring import MonitoringSettings
from ros2_kafka_bridge.logs.summed import Summed
from ros2_kafka_bridge.monitoring.state import Watch
from ros2_kafka_bridge.web.caller import RIGHT_SHOWN, SocketAddress, user_of, who
from ros2_kafka_bridge.web.guard import Refusal, is_loopback

_WRONG_TOKEN_S: Final = 0.5
_PASSED_ON: Final = ('forwarded', 'x-forwarded-for', 'x-real-ip')  # by a proxy, for another


class Rights:
    """Looks at the token that comes with a request.

    Args:
        watch: Knows the bridge.
        said: The log, which is told how many wrong ones came.
    """

    def __init__(self, watch: Watch, said: Summed) -> None:
        self._watch = watch
        self._said = said

    @property
    def settings(self) -> MonitoringSettings:
        """Those that count now."""
        return self._watch.config.monitoring or MonitoringSettings()

    async def require_token(self, request: Request) -> Refusal | None:
        """Why a request may not have what needs the token; None if it may."""
        given = request.headers.get('authorization', '')
        refusal = _without_right(self.settings, given)
        if refusal is None:
            request.scope[RIGHT_SHOWN] = True
        elif given:
            whom = f' from {who(request.client)}'
            self._said.warning('the page: a wrong token', whom, kind='token')
            await asyncio.sleep(_WRONG_TOKEN_S)  # who guesses, guesses slowly
        return refusal

    async def reject_wrong_token(self, request: Request) -> Refusal | None:
        """Why a request is refused that needs no token; None where it shows none.

        A proxy may hand on what a browser has shown to it (Basic).
        """
        shows_one = request.headers.get('authorization', '').lower().startswith('bearer ')
        if self.settings.token is None or not shows_one:
            return None
        return await self.require_token(request)


def _without_right(settings: MonitoringSettings, authorization: str) -> Refusal | None:
    if settings.token is None:
        text = (
            'this bridge can only be looked at: its configuration names no monitoring.token; '
            'make one with: openssl rand -hex 16'
        )
        return Refusal(HTTPStatus.FORBIDDEN, text)
    scheme, _, given = authorization.partition(' ')
    right = hmac.compare_digest(given.strip().encode(), settings.token.encode())
    if scheme.lower() == 'bearer' and right:
        return None
    said = 'this is not the token' if given else 'it needs the token'
    return Refusal(HTTPStatus.UNAUTHORIZED, f'{said} of the bridge (monitoring.token)')


def is_of_own_user(request: Request) -> bool:
    """Whether a program of the bridge's own user asks, which may read what the bridge reads.

    `Host` and an address do not say it: a proxy on this machine passes on what others send.
    """
    headers, client, server = request.headers, request.client, request.scope.get('server')
    if any(name in headers for name in _PASSED_ON) or not is_loopback(headers.get('host', '')):
        return False
    if client is None or server is None:
        return False
    return user_of(SocketAddress(*client), SocketAddress(*server)) == os.getuid()
