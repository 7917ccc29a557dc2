"""Who may talk to the page: its own pages, under the names that it was told.

A page of another site can make a browser send requests here. It cannot set `Host` or `Origin`:
a wrong `Host` is a name that was bent to this address (DNS rebinding), a wrong `Origin` is
another site's page.
"""

from http import HTTPStatus
from typing import Final

from starlette.datastructures import Headers
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

_POLICY: Final = (
    b"default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    b"connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS: Final = (
    (b'content-security-policy', _POLICY),
    (b'x-content-type-options', b'nosniff'),
    (b'referrer-policy', b'no-referrer'),
    (b'cross-origin-resource-policy', b'same-origin'),
    (b'cross-origin-opener-policy', b'same-origin'),
    (b'cache-control', b'no-store'),
)
_READS: Final = frozenset({'GET', 'HEAD'})


class Guard:
    """Refuses requests of others, and adds the headers that keep the page to itself.

    Args:
        app: What is guarded.
        names: What may stand in `Host`, with and without the port.
    """

    def __init__(self, app: ASGIApp, names: frozenset[str]) -> None:
        self._app = app
        self._names = names

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:  # noqa: D102
        if scope['type'] != 'http':
            await self._app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message['type'] == 'http.response.start':
                message = {**message, 'headers': [*message['headers'], *_HEADERS]}
            await send(message)

        refusal = self._refusal(scope['method'], Headers(scope=scope))
        if refusal is None:
            await self._app(scope, receive, send_with_headers)
            return
        status, sentence = refusal
        response = JSONResponse({'error': sentence}, status)
        await response(scope, receive, send_with_headers)

    def _refusal(self, method: str, headers: Headers) -> tuple[HTTPStatus, str] | None:
        host = headers.get('host', '').lower()
        if host not in self._names:
            return (
                HTTPStatus.MISDIRECTED_REQUEST,
                f'this page is not {host!r}; start it with --allow-host to serve that name',
            )
        if method in _READS:
            return None
        origin = headers.get('origin', '').lower()
        if origin not in {f'http://{host}', f'https://{host}'}:
            return HTTPStatus.FORBIDDEN, f'a page of {origin or "nobody"} may order nothing here'
        kind = headers.get('content-type', '').partition(';')[0].strip().lower()
        if kind != 'application/json':
            return HTTPStatus.UNSUPPORTED_MEDIA_TYPE, 'the body must be application/json'
        return None
