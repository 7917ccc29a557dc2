"""A Schema Registry for tests: strict with its clients, and as unwell as a test asks for.

It speaks the protocol of Confluent's registry, as far as writers and readers of records use it,
with the real one's codes of errors and real checks of compatibility. What a client asks in a way
that the protocol does not have is answered with an error and kept in `problems`.
"""

import base64
import binascii
import json
import ssl
import threading
from collections import defaultdict
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import Any, Final, NamedTuple, Self
from urllib.parse import parse_qsl, unquote, urlsplit

from support.registry.schemas import Entry, References, RefusedError, check, key, misfits

JSON_TYPE: Final = 'application/vnd.schemaregistry.v1+json'
LEVELS: Final = frozenset(
    f'{level}{more}' for level in ('BACKWARD', 'FORWARD', 'FULL') for more in ('', '_TRANSITIVE')
) | {'NONE'}
_QUERIES: Final = frozenset(
    {'deleted', 'deletedOnly', 'fetchMaxId', 'format', 'limit', 'normalize', 'offset'}
    | {'referenceFormat', 'subject', 'verbose', 'deleted_only', 'reference_format'}
)
"""The last two are confluent-kafka's own spelling, which the real one passes over."""
_BOOLEANS: Final = frozenset({'deleted', 'deletedOnly', 'fetchMaxId', 'normalize', 'verbose'})
_BODY: Final = frozenset({'schema', 'schemaType', 'references', 'metadata', 'ruleSet'})
_REFERENCE: Final = frozenset({'name', 'subject', 'version'})
_PATIENCE_S: Final = 60


class Request(NamedTuple):
    """One request, as it came."""

    method: str
    path: str
    query: dict[str, str]


class RegistryServer:
    """A registry on 127.0.0.1, in threads of this process.

    Args:
        users: Passwords by name; None where nobody has to say who they are.
        tls: Makes it speak TLS.

    Attributes:
        requests: All that came.
        problems: What clients asked that the protocol does not have.
        read_only: Whether it takes no new schemas.
        exact: Whether spaces make another schema of one, as with Apicurio's registry.
        forbidden: Subjects that nobody may write.
    """

    def __init__(
        self, users: dict[str, str] | None = None, tls: ssl.SSLContext | None = None
    ) -> None:
        self.requests: list[Request] = []
        self.problems: list[str] = []
        self.users = users
        self.read_only = False
        self.exact = False
        self.forbidden: set[str] = set()
        self._tls = tls
        self._port = 0
        self._lock = threading.Lock()
        self._versions: defaultdict[str, list[Entry]] = defaultdict(list)
        self._levels = {'': 'BACKWARD'}
        self._answers: list[tuple[int, bytes]] = []
        self._hanging = threading.Event()
        self._released = threading.Event()
        self._server: _Server | None = None

    @property
    def url(self) -> str:
        """Where it is, the same through all restarts."""
        return f'http{"s" if self._tls else ""}://127.0.0.1:{self._port}'

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stop()

    def start(self) -> None:
        """Listen; again at the same port, with the same schemas, after a stop."""
        self._released.clear()
        self._server = _Server(self, ('127.0.0.1', self._port))
        if self._tls:
            self._server.socket = self._tls.wrap_socket(
                self._server.socket, server_side=True, do_handshake_on_connect=False
            )
        self._port = self._server.server_address[1]
        threading.Thread(target=self._server.serve_forever, args=(0.02,), daemon=True).start()

    def stop(self) -> None:
        """End all connections and answer nothing any more."""
        self._released.set()
        if self._server:
            self._server.shutdown()
            self._server.server_close()
            self._server.end_connections()
            self._server = None

    def answer(self, status: int, times: int = 1, body: bytes | None = None) -> None:
        """Answer the next requests with this status, whatever they ask."""
        made = json.dumps({'error_code': status, 'message': f'told to answer {status}'}).encode()
        self._answers += [(status, made if body is None else body)] * times

    def hang(self) -> None:
        """Answer no request from now on, until it is stopped."""
        self._hanging.set()

    def set_compatibility(self, level: str, subject: str = '') -> None:
        """What a new version must be: of one subject, or of all that have no level themselves."""
        assert level in LEVELS, level
        self._levels[subject] = level

    def subjects(self) -> list[str]:
        """All that have a version."""
        return sorted(self._versions)

    def versions(self, subject: str) -> list[Entry]:
        """All of one subject."""
        return list(self._versions[subject])

    def register(
        self,
        subject: str,
        text: str,
        kind: str = 'AVRO',
        references: References = (),
        rules: dict[str, Any] | None = None,
    ) -> int:
        """Register a schema from within, without looking at it; gives its id."""
        with self._lock:
            added = self._added(subject, kind, text, references)
            self._versions[subject][-1] = added._replace(rules=rules)
            return added.id

    def asked(self, request: Request, headers: Any, body: bytes) -> tuple[int, bytes]:
        """The status and the body that answer a request."""
        with self._lock:
            self.requests.append(request)
            told = self._answers.pop(0) if self._answers else None
        if self._hanging.is_set():
            self._released.wait(_PATIENCE_S)
        if told:
            return told
        try:
            self._check_user(headers.get('Authorization', ''))
            self._check(request, headers)
            with self._lock:
                answer = self._answered(request, body)
        except RefusedError as error:
            shown = {'error_code': error.code, 'message': error.message}
            return error.status, json.dumps(shown).encode()
        return 200, json.dumps(answer).encode()

    def _check_user(self, authorization: str) -> None:
        if self.users is None:
            return
        kind, _, encoded = authorization.partition(' ')
        try:
            name, _, password = base64.b64decode(encoded).decode().partition(':')
        except (binascii.Error, UnicodeDecodeError):
            name, password = '', ''
        if kind != 'Basic' or self.users.get(name) != password:
            raise RefusedError(401, 'Unauthorized')

    def _check(self, request: Request, headers: Any) -> None:
        wrong = [f'query {name}' for name in request.query if name not in _QUERIES]
        wrong += [
            f'query {name}={value}'
            for name, value in request.query.items()
            if name in _BOOLEANS and value.lower() not in {'true', 'false'}
        ]
        if request.method == 'GET' and JSON_TYPE not in headers.get('Accept', ''):
            wrong.append(f'Accept: {headers.get("Accept")}')
        if request.method != 'GET' and headers.get('Content-Type') != JSON_TYPE:
            wrong.append(f'Content-Type: {headers.get("Content-Type")}')
        if wrong:
            raise self._problem(request, ', '.join(wrong), 400)

    def _problem(self, request: Request, what: str, code: int) -> RefusedError:
        self.problems.append(f'{request.method} {request.path}: {what}')
        return RefusedError(code, what)

    def _answered(self, request: Request, body: bytes) -> Any:
        parts = [unquote(part) for part in request.path.strip('/').split('/')]
        answer: Any = None
        match request.method, parts:
            case 'GET', ['subjects']:
                answer = self.subjects()
            case 'GET', ['config']:
                answer = {'compatibilityLevel': self._levels['']}
            case 'GET', ['schemas', 'types']:
                answer = ['AVRO', 'JSON', 'PROTOBUF']
            case 'GET', ['schemas', 'ids', number]:
                answer = self._by_id(number).shown
            case 'GET', ['subjects', subject, 'versions']:
                answer = [entry.version for entry in self._known(subject)]
            case 'GET', ['subjects', subject, 'versions', version]:
                answer = _full(self._by_version(subject, version))
            case 'POST', ['subjects', subject]:
                answer = _full(self._looked_up(subject, *self._schema(request, body)))
            case 'POST', ['subjects', subject, 'versions']:
                answer = {'id': self._registered(subject, *self._schema(request, body)).id}
            case 'POST', ['compatibility', 'subjects', subject, 'versions', version]:
                self._by_version(subject, version)
                fits = self._fits(subject, *self._schema(request, body))
                answer = {'is_compatible': fits}
            case _:
                raise self._problem(request, 'HTTP 404 Not Found', 404)
        return answer

    def _schema(self, request: Request, body: bytes) -> tuple[str, str, References]:
        """Kind, text and references that a request has in its body."""
        try:
            found = json.loads(body)
        except ValueError as error:
            raise self._problem(request, f'body: {error}', 400) from None
        if not isinstance(found, dict) or set(found) - _BODY:
            raise self._problem(request, f'body: {sorted(found)}', 422)
        references = found.get('references') or []
        if any(set(reference) != _REFERENCE for reference in references):
            raise self._problem(request, f'references: {references}', 422)
        text, kind = found.get('schema'), found.get('schemaType', 'AVRO')
        if not isinstance(text, str) or kind not in {'AVRO', 'JSON', 'PROTOBUF'}:
            raise self._problem(request, f'schema: {text!r} of {kind!r}', 422)
        return (
            kind,
            text,
            tuple((one['name'], one['subject'], one['version']) for one in references),
        )

    def _registered(self, subject: str, kind: str, text: str, references: References) -> Entry:
        if subject in self.forbidden:
            raise RefusedError(40301, f'User is denied operation Write on Subject: {subject}')
        for name, place, version in references:
            try:
                self._by_version(place, str(version))
            except RefusedError:
                raise RefusedError(42201, f'No schema reference found for {name}') from None
        check(kind, text, self._named(references))
        same = self._same(subject, kind, text, references)
        if same:
            return same
        if self.read_only:
            raise RefusedError(42205, f'Subject {subject} is in read-only mode')
        self._check_compatible(subject, kind, text, references)
        return self._added(subject, kind, text, references)

    def _added(self, subject: str, kind: str, text: str, references: References) -> Entry:
        everything = [entry for entries in self._versions.values() for entry in entries]
        wanted = key(kind, text, references)
        ids = {key(one.kind, one.text, one.references): one.id for one in everything}
        number = ids.get(wanted, 1 + max(ids.values(), default=0))
        version = len(self._versions[subject]) + 1
        entry = Entry(subject, version, number, kind, text, references)
        self._versions[subject].append(entry)
        return entry

    def _looked_up(self, subject: str, kind: str, text: str, references: References) -> Entry:
        self._known(subject)
        same = self._same(subject, kind, text, references)
        if same is None or (self.exact and same.text != text):
            raise RefusedError(40403, 'Schema not found')
        return same

    def _same(self, subject: str, kind: str, text: str, references: References) -> Entry | None:
        wanted = key(kind, text, references)
        found = self._versions.get(subject, ())
        return next((e for e in found if key(e.kind, e.text, e.references) == wanted), None)

    def _known(self, subject: str) -> list[Entry]:
        if not self._versions.get(subject):
            raise RefusedError(40401, f"Subject '{subject}' not found.")
        return self._versions[subject]

    def _by_version(self, subject: str, version: str) -> Entry:
        entries = self._known(subject)
        number = len(entries) if version in {'latest', '-1'} else int(version)
        if not 1 <= number <= len(entries):
            raise RefusedError(40402, f'Version {version} not found.')
        return entries[number - 1]

    def _by_id(self, number: str) -> Entry:
        for entries in self._versions.values():
            for entry in entries:
                if str(entry.id) == number:
                    return entry
        raise RefusedError(40403, f'Schema {number} not found')

    def _named(self, references: References) -> list[str]:
        """The texts that a schema refers to, each behind those that it needs."""
        texts: list[str] = []
        for _, subject, version in references:
            entry = self._by_version(subject, str(version))
            texts += [*self._named(entry.references), entry.text]
        return list(dict.fromkeys(texts))

    def _fits(self, subject: str, kind: str, text: str, references: References) -> bool:
        try:
            self._check_compatible(subject, kind, text, references)
        except RefusedError:
            return False
        return True

    def _check_compatible(
        self, subject: str, kind: str, text: str, references: References
    ) -> None:
        level = self._levels.get(subject, self._levels[''])
        others = self._versions[subject] if level.endswith('TRANSITIVE') else []
        for old in others or self._versions[subject][-1:]:
            if level == 'NONE':
                return
            if old.kind != kind:
                raise RefusedError(409, f'Incompatible because of different schema type: {kind}')
            new = (text, self._named(references))
            before = (old.text, self._named(old.references))
            pairs = [(new, before)] * (not level.startswith('FORWARD'))
            pairs += [(before, new)] * (not level.startswith('BACKWARD'))
            details = [line for pair in pairs for line in misfits(kind, *pair)]
            if details:
                raise RefusedError(
                    409,
                    'Schema being registered is incompatible with an earlier schema for subject '
                    f'"{subject}", details: [{", ".join(details)}, '
                    f"{{oldSchemaVersion: {old.version}}}, {{compatibility: '{level}'}}]",
                )


def _full(entry: Entry) -> dict[str, Any]:
    return {
        'subject': entry.subject, 'version': entry.version, 'id': entry.id, **entry.shown
    }  # fmt: skip


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    allow_reuse_address = True

    def __init__(self, registry: RegistryServer, address: tuple[str, int]) -> None:
        self.registry = registry
        self._open: set[Any] = set()
        super().__init__(address, _Handler)

    def process_request(self, request: Any, client_address: Any) -> None:
        self._open.add(request)
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        self._open.discard(request)
        super().shutdown_request(request)

    def end_connections(self) -> None:
        """End what clients keep open for their next request."""
        for request in list(self._open):
            self.shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that goes away, or does not trust this server, is no error here."""


class _Handler(BaseHTTPRequestHandler):
    protocol_version = 'HTTP/1.1'
    # Headers and body are two small packets: the second one would wait 40 ms for an answer.
    disable_nagle_algorithm = True
    server: _Server

    def _answer(self) -> None:
        body = self.rfile.read(int(self.headers.get('Content-Length') or 0))
        url = urlsplit(self.path)
        request = Request(str(self.command), url.path, dict(parse_qsl(url.query)))
        status, answer = self.server.registry.asked(request, self.headers, body)
        self.send_response(status)
        self.send_header('Content-Type', JSON_TYPE)
        self.send_header('Content-Length', str(len(answer)))
        self.end_headers()
        self.wfile.write(answer)

    do_GET = do_POST = do_PUT = do_DELETE = _answer  # noqa: N815 -- the names of http.server

    def log_message(self, *args: Any) -> None:
        """Tests read `requests`."""
