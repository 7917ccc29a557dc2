"""Who may ask for what.

A page of another site can make a browser send requests here. It cannot set `Host` or `Origin`:
a wrong `Host` is a name that was bent to this address (DNS rebinding), a wrong `Origin` is
another site's page. No cookie is used, so a browser adds nothing of its own to such a request.
"""

from collections.abc import Callable, Iterable
from http import HTTPStatus
from typing import Final, NamedTuple

from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ros2_kafka_bridge.logs.text import printable

_POLICY: Final = (
    b"default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    b"connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS: Final = (
    (b'content-security-policy', _POLICY),
    (b'x-content-type-options', b'nosniff'),
    (b'x-frame-options', b'DENY'),
    (b'referrer-policy', b'no-referrer'),
    (b'cross-origin-resource-policy', b'same-origin'),
    (b'cross-origin-opener-policy', b'same-origin'),
    (b'permissions-policy', b'camera=(), geolocation=(), microphone=()'),
)
_READS: Final = frozenset({'GET', 'HEAD'})
_LOOPBACK: Final = frozenset({'127.0.0.1', 'localhost', '::1'})
_SCHEMES: Final = ('http', 'https')
_OWN_SITES: Final = frozenset({'same-origin', 'none'})  # none: typed in, or from a bookmark
_LINK: Final = ('navigate', 'document')
_ANY: Final = frozenset({'0.0.0.0', '::'})  # noqa: S104 (only compared)


class Names(NamedTuple):
    """What may stand in `Host`.

    Args:
        hosts: In lower case, with and without the port.
        added: Those of them that the user has named.
    """

    hosts: frozenset[str]
    added: frozenset[str]


def names_of(host: str, port: int, more: Iterable[str] = ()) -> Names:
    """The names of a page: the address that it listens on, this machine's, and further ones."""
    own = {host} - _ANY
    if host in _LOOPBACK | _ANY:
        own |= _LOOPBACK
    added = _with_port(more, port)
    return Names(_with_port(own, port) | added, added)


def _with_port(names: Iterable[str], port: int) -> frozenset[str]:
    bare = {f'[{name}]' if name.count(':') > 1 and '[' not in name else name for name in names}
    return frozenset({one for name in bare for one in (name.lower(), f'{name.lower()}:{port}')})


def is_loopback(host: str) -> bool:
    """Whether a `Host` names this machine itself."""
    name = host[1:].partition(']')[0] if host.startswith('[') else host.partition(':')[0]
    return name.lower() in _LOOPBACK


class Refusal(NamedTuple):
    """Why something is not done."""

    status: HTTPStatus
    text: str


def refused(refusal: Refusal) -> Response:
    """Tell why something is not done."""
    needs_token = refusal.status is HTTPStatus.UNAUTHORIZED
    headers = {'www-authenticate': 'Bearer'} if needs_token else {}
    return JSONResponse({'error': refusal.text}, refusal.status, headers)


def without_json(headers: Headers) -> Refusal | None:
    """Why the body of a request may not be read; None if it may.

    The form of a page of another site can send every kind but this one, without being asked first.
    """
    kind = headers.get('content-type', '').partition(';')[0].strip().lower()
    if kind == 'application/json':
        return None
    return Refusal(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, 'the body must be application/json')


async def read_body(request: Request, most_bytes: int) -> bytes | Refusal:
    """The body of a request, or why it is not read to its end.

    Raises:
        ClientDisconnect: It does not come to its end.
    """
    body = bytearray()
    async for part in request.stream():
        body += part
        if len(body) > most_bytes:
            text = f'the body is over {most_bytes // 1024} KiB'
            return Refusal(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, text)
    return bytes(body)


class Guard:
    """Refuses requests of others, and adds the headers that keep the page to itself.

    Args:
        app: What is guarded.
        names: Tells what may stand in `Host`, as it is now.
        cure: What to do where a further name is to be served.
        open_paths: What programs ask for, by addresses that nobody can list.
        has_token: Whether the app asks for a token before it changes something. Without one,
            `Origin` alone tells the page itself from others: then it must be there.
    """

    def __init__(
        self,
        app: ASGIApp,
        names: Callable[[], Names],
        cure: str,
        open_paths: frozenset[str] = frozenset(),
        *,
        has_token: bool = False,
    ) -> None:
        self._app = app
        self._names = names
        self._cure = cure
        self._open_paths = open_paths
        self._has_token = has_token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:  # noqa: D102
        if scope['type'] != 'http':
            await self._app(scope, receive, send)
            return
        is_static = scope['path'].startswith('/static/')
        cache = (b'cache-control', b'no-cache' if is_static else b'no-store')

        async def send_with_headers(message: Message) -> None:
            if message['type'] == 'http.response.start':
                message = {**message, 'headers': [*message['headers'], *_HEADERS, cache]}
            await send(message)

        refusal = self._refusal(scope['method'], scope['path'], Headers(scope=scope))
        if refusal is None:
            await self._app(scope, receive, send_with_headers)
            return
        await refused(refusal)(scope, receive, send_with_headers)

    def _refusal(self, method: str, path: str, headers: Headers) -> Refusal | None:
        reads = method in _READS
        is_open = reads and path in self._open_paths
        host = headers.get('host', '').lower()
        names = self._names()
        if host not in names.hosts and not is_open:
            text = f'this page is not {printable(host)!r}: {self._cure}'
            return Refusal(HTTPStatus.MISDIRECTED_REQUEST, text)
        if not reads:
            return self._cross_site(headers, host, names)
        if path.startswith('/api/') or (is_open and not _is_link(headers)):
            return _read_from_elsewhere(headers)
        return None

    def _cross_site(self, headers: Headers, host: str, names: Names) -> Refusal | None:
        """Why a request may not change anything, whoever sends it.

        A program that is no browser sends no `Origin`: the token alone speaks for it.
        """
        origin = headers.get('origin', '').lower()
        if not (origin or self._has_token or 'sec-fetch-site' in headers):
            text = 'a request without Origin may change nothing here'
            return Refusal(HTTPStatus.FORBIDDEN, text)
        allowed = {f'{scheme}://{name}' for name in (host, *names.added) for scheme in _SCHEMES}
        is_own = origin in allowed or (self._has_token and not origin)
        if is_own and _is_of_own_site(headers):
            return None
        who = printable(origin) or 'another site'
        return Refusal(HTTPStatus.FORBIDDEN, f'a page of {who} may change nothing here')


def _read_from_elsewhere(headers: Headers) -> Refusal | None:
    """Why what a page of another site makes a browser ask for is not even looked up.

    It could not read the answer; but each would cost Kafka a look at its dead letters. Who follows
    a link is a person: the page of Prometheus has one to each of its targets.
    """
    if _is_of_own_site(headers):
        return None
    return Refusal(HTTPStatus.FORBIDDEN, 'a page of another site may ask for nothing here')


def _is_link(headers: Headers) -> bool:
    return (headers.get('sec-fetch-mode'), headers.get('sec-fetch-dest')) == _LINK


def _is_of_own_site(headers: Headers) -> bool:
    return headers.get('sec-fetch-site', 'none') in _OWN_SITES
