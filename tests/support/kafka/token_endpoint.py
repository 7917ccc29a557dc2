"""An OAuth 2 server of a test, which gives tokens for as long as it is to."""

import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Self

import jwt
from cryptography.hazmat.primitives.asymmetric import rsa

from ros2_kafka_bridge.testing.local_kafka import HOST


class TokenEndpoint:
    """An OAuth 2 server on this machine: `/token` gives tokens, `/keys` the keys to check them.

    With `broken` it answers every request for a token with an error.

    Args:
        user: The only one there is.
        life_s: How long a token is good.
    """

    def __init__(self, user: str, life_s: int) -> None:
        self.life_s = life_s
        self.broken = False
        self.given = 0
        self._user = user
        self._expires_s = 0.0
        self._key = rsa.generate_private_key(public_exponent=65537, key_size=2048)
        endpoint = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                self._answer(200, endpoint.keys())

            def do_POST(self) -> None:
                self.rfile.read(int(self.headers.get('Content-Length', 0)))
                if endpoint.broken:
                    self._answer(
                        400,
                        {'error': 'unavailable', 'error_description': 'no tokens just now'},
                    )
                else:
                    endpoint.given += 1
                    self._answer(200, endpoint.token())

            def _answer(self, status: int, content: dict[str, Any]) -> None:
                body = json.dumps(content).encode()
                self.send_response(status)
                self.send_header('Content-Type', 'application/json')
                self.send_header('Content-Length', str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, *_: Any) -> None:
                pass

        self._server = ThreadingHTTPServer((HOST, 0), Handler)
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()

    @contextmanager
    def out_of_order(self) -> Iterator[None]:
        """Give no token for a while."""
        self.broken = True
        try:
            yield
        finally:
            self.broken = False

    @property
    def url(self) -> str:
        """Where tokens are given."""
        return f'http://{HOST}:{self._server.server_port}/token'

    @property
    def keys_url(self) -> str:
        """Where the broker finds the public key."""
        return f'http://{HOST}:{self._server.server_port}/keys'

    def all_expired(self) -> bool:
        """Whether no token that was given is good any more."""
        return time.time() > self._expires_s

    def keys(self) -> dict[str, Any]:
        """The public key, as the broker asks for it."""
        public = json.loads(jwt.algorithms.RSAAlgorithm.to_jwk(self._key.public_key()))
        return {'keys': [{**public, 'kid': 'test', 'use': 'sig', 'alg': 'RS256'}]}

    def token(self) -> dict[str, Any]:
        """A token of the one user there is."""
        now = int(time.time())
        self._expires_s = now + self.life_s
        claims = {'sub': self._user, 'iat': now, 'exp': now + self.life_s, 'aud': 'kafka'}
        made = jwt.encode(claims, self._key, algorithm='RS256', headers={'kid': 'test'})
        return {'access_token': made, 'token_type': 'Bearer', 'expires_in': self.life_s}
