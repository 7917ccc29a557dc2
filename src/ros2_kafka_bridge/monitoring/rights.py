"""Who shows the token, and who shows a wrong one."""

import asyncio
from collections.abc import Mapping
from typing import Final

from starlette.requests import Request

from ros2_kafka_bridge.config.monitoring import MonitoringSettings
from ros2_kafka_bridge.logs.summed import Summed
from ros2_kafka_bridge.monitoring.caller import who
from ros2_kafka_bridge.monitoring.guard import Refusal, without_right
from ros2_kafka_bridge.monitoring.state import Watch

_WRONG_TOKEN_S: Final = 0.5
_SHOWN: Final = 'ros2_kafka_bridge.token_shown'


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
        refusal = without_right(self.settings, given)
        if refusal is None:
            request.scope[_SHOWN] = True
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


def has_shown_token(scope: Mapping[str, object]) -> bool:
    """Whether a request has come with the right one."""
    return bool(scope.get(_SHOWN))
