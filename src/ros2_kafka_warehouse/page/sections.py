"""Sections of what browsers are shown, each given anew when it has changed.

A section has a version, which grows when it changes: a browser that says what it has seen is
given the sections that are newer, each whole. So it may miss any number of them.
"""

import logging
from collections.abc import Callable, Mapping
from typing import Any, Final

import msgspec

_LOG: Final = logging.getLogger(__name__)


class Sections:
    """The sections by name, and which of them is how new.

    Args:
        makes: Makes what stands in a section, as it is now.
    """

    def __init__(self, makes: Mapping[str, Callable[[], Any]]) -> None:
        self._makes = makes
        self._version = 0
        self._versions: dict[str, int] = {}
        self._encoded: dict[str, tuple[int, bytes]] = {}
        self._unmade: set[str] = set()

    def change(self, name: str) -> None:
        """Note that a section has changed."""
        self._version += 1
        self._versions[name] = self._version

    def newer(self, seen: dict[str, int]) -> bytes:
        """The sections that changed since, as one JSON object, b'' for none; `seen` is updated."""
        parts = []
        for name, version in self._versions.items():
            if seen.get(name, -1) < version:
                seen[name] = version
                if section := self._section(name, version):
                    parts.append(b'"%s":%s' % (name.encode(), section))
        return b'{%s}' % b','.join(parts) if parts else b''

    def _section(self, name: str, version: int) -> bytes:
        kept, encoded = self._encoded.get(name, (-1, b''))
        if kept == version:
            return encoded
        try:
            encoded = msgspec.json.encode(self._makes[name]())
            self._unmade.discard(name)
        except Exception:  # noqa: BLE001 (whatever anybody has put into Kafka)
            # A browser keeps what it has; the other sections go on.
            encoded = b''
            if name not in self._unmade:
                self._unmade.add(name)
                _LOG.exception('cannot show the section %s', name)
        self._encoded[name] = (version, encoded)
        return encoded
