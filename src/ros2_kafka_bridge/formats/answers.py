"""What a Schema Registry may answer: so many bytes, and in so much time, to all that is asked.

Its client reads whatever comes, and waits between two bytes only. The address in the file may be
that of something else, and between the two may be anything.
"""

import contextlib
import socket
import threading
import zlib
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

from confluent_kafka.schema_registry.common._httpx_compat import httpx

if TYPE_CHECKING:
    from confluent_kafka.schema_registry import SchemaRegistryClient

MOST_BYTES: Final = 4_000_000
"""Of one answer, unpacked; a schema has a megabyte at most. As JSON it takes 30 times as much."""
MOST_BYTES_IN_ALL: Final = 32_000_000
"""Of all answers to one question of the bridge, which may refer to many schemas."""
MOST_S: Final = 20.0
"""From its beginning to the last byte of the last answer."""

_PIECE_BYTES: Final = 65_536
_GZIP: Final = 16 + zlib.MAX_WBITS
_PACKINGS: Final = frozenset({'', 'identity', 'gzip', 'x-gzip'})


class UnboundedError(Exception):
    """Why an answer was not read to its end."""


class Bounds:
    """The bounds of a client, for one question at a time.

    Args:
        client: confluent-kafka's own. What asks for its tokens is bounded as well.
    """

    def __init__(self, client: 'SchemaRegistryClient') -> None:
        self._sockets: list[socket.socket] = []
        self._left_bytes = 0
        self._question: object = None
        self._ended_for = ''
        self._lock = threading.Lock()
        for session in _sessions(client):
            session.headers['accept-encoding'] = 'gzip'
            session.event_hooks = {
                'request': [*session.event_hooks['request'], self._begin],
                'response': [*session.event_hooks['response'], self._bound],
            }

    @contextlib.contextmanager
    def kept(self) -> Iterator[None]:
        """Ask within the bounds.

        Raises:
            UnboundedError: They were reached; what was read is thrown away.
        """
        question = self._question = object()
        self._left_bytes, self._ended_for = MOST_BYTES_IN_ALL, ''
        timer = threading.Timer(MOST_S, self._end, [question])
        timer.daemon = True
        timer.start()
        try:
            yield
        except Exception as error:
            if self._ended_for:
                raise UnboundedError(self._ended_for) from error
            raise
        finally:
            self._question = None
            timer.cancel()

    def _begin(self, request: Any) -> None:
        if self._ended_for:
            raise UnboundedError(self._ended_for)
        request.extensions = {**request.extensions, 'trace': self._note_socket}

    def _note_socket(self, event: str, info: dict[str, Any]) -> None:
        """Keep each socket that a connection is made of: the one below TLS, too."""
        if not event.endswith(('connect_tcp.complete', 'start_tls.complete')):
            return
        made = info['return_value'].get_extra_info('socket')
        with self._lock:
            self._sockets = [one for one in self._sockets if one.fileno() != -1]
            self._sockets.append(made)
        if self._ended_for:
            self._shut()

    def _end(self, question: object) -> None:
        """Time is up: whoever reads from a connection finds its end."""
        if question is self._question:
            self._ended_for = f'its answers have not ended after {MOST_S:g} s'
            self._shut()

    def _shut(self) -> None:
        with self._lock:
            for one in self._sockets:
                # Not closed: the thread that reads from it would read from the next one to get
                # its number. And not by the class of TLS, which takes its state away for that.
                with contextlib.suppress(OSError):
                    socket.socket.shutdown(one, socket.SHUT_RDWR)

    def _bound(self, response: Any) -> None:
        """Read what is in the body of a response by this object alone."""
        packing = response.headers.pop('content-encoding', '').strip().lower()
        if packing not in _PACKINGS:
            raise self._ended(f'its answer is packed as {packing!r:.40}, which nobody asked for')
        response.stream = _Body(self, response.stream, is_packed='gzip' in packing)

    def take(self, size: int, so_far: int) -> None:
        """Count bytes of a body.

        Args:
            size: How many more there are.
            so_far: Of the same answer, with these.

        Raises:
            UnboundedError: They are too many.
        """
        self._left_bytes -= size
        if so_far > MOST_BYTES:
            raise self._ended(f'its answer has more than {MOST_BYTES:,} bytes')
        if self._left_bytes < 0:
            raise self._ended(f'its answers have more than {MOST_BYTES_IN_ALL:,} bytes')

    def _ended(self, why: str) -> UnboundedError:
        self._ended_for = self._ended_for or why
        return UnboundedError(self._ended_for)


class _Body(httpx.SyncByteStream):
    """The body of a response, unpacked in pieces: a kilobyte may hold a megabyte."""

    def __init__(self, bounds: Bounds, stream: Any, *, is_packed: bool) -> None:
        self._bounds = bounds
        self._stream = stream
        self._unpack = zlib.decompressobj(_GZIP) if is_packed else None

    def __iter__(self) -> Iterator[bytes]:
        so_far = 0
        for piece in self._stream:
            for part in self._parts(piece):
                so_far += len(part)
                self._bounds.take(len(part), so_far)
                yield part

    def _parts(self, piece: bytes) -> Iterator[bytes]:
        if self._unpack is None:
            yield piece
            return
        while piece:
            try:
                yield self._unpack.decompress(piece, _PIECE_BYTES)
            except zlib.error as error:
                raise httpx.DecodingError(str(error)) from error
            piece = self._unpack.unconsumed_tail

    def close(self) -> None:
        """Let the connection go."""
        self._stream.close()


def _sessions(client: 'SchemaRegistryClient') -> list[Any]:
    """What a client asks by: the registry, and whoever gives tokens for it."""
    rest: Any = getattr(client, '_rest_client', None)
    if rest is None:
        return []  # the one that its makers test with
    tokens = getattr(rest.bearer_field_provider, 'client', None)
    return [rest.session, *([tokens] if isinstance(tokens, httpx.Client) else [])]
