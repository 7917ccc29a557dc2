"""The dead letters of a bridge for its page: which there are, and what is in one."""

import base64
import heapq
import json
import time
from collections.abc import Iterable
from typing import Any, Final

import msgspec

from ros2_kafka_bridge.commands.dead_letters.definition import definition_of
from ros2_kafka_bridge.commands.dead_letters.report import NOT_OURS, open_reader, unseen_in_words
from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.config.settings import Config, KafkaToRosRoute
from ros2_kafka_bridge.dead_letters.letter import Letter, LetterPlace, Mark
from ros2_kafka_bridge.dead_letters.shown import escaped, hex_lines, shortened
from ros2_kafka_bridge.errors import BridgeError
from ros2_kafka_bridge.formats.json import make_encode
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.kafka.letters import LetterReader
from ros2_kafka_bridge.logs.text import count, printable, printable_lines
from ros2_kafka_bridge.message_types.description import make_layout
from ros2_kafka_bridge.message_types.layout import Layout
from ros2_kafka_bridge.message_types.source import NOT_SHOWN, Definitions, TypeSource
from ros2_kafka_bridge.route.format import decode_of

MOST_OFFSETS: Final = 2000
MOST_LETTERS: Final = 500
_MOST_IN_ALL: Final = 40_000
_READING_S: Final = 10.0
_SHOWN_BYTES: Final = 64 * 1024
_HEX_BYTES: Final = 4096
_FORMATTED_CHARS: Final = 1024 * 1024
_FORMATTED_BYTES: Final = 256 * 1024
_REASON_CHARS: Final = 500
_KEY_CHARS: Final = 200
_HEADER_CHARS: Final = 2000
_TOPIC_CHARS: Final = 300

Json = dict[str, Any]


def newest(config: Config, topic: str) -> Json:
    """The newest letters of a dead-letter topic, newest first.

    Raises:
        BridgeError: Kafka is away, or does not let this user read.
    """
    listed = _Listed()
    deadline_s = time.monotonic() + _READING_S
    with open_reader(config) as reader:
        there = reader.has(topic)
        most = _offsets_of_each(reader, topic) if there else 0
        for found in reader.newest(topic, most, deadline_s) if there else ():
            listed.note(found)
        unseen = [unseen_in_words(place) for place in reader.unseen.values()]
        unseen += [_cut_in_words(reader.cut)] if reader.cut else []
    return {
        'topic': topic,
        'there': there,
        'seen': len(listed.places),
        'replayed': sum(place in listed.marks for place in listed.places),
        'unseen': unseen,
        'letters': listed.rows(),
    }


def _offsets_of_each(reader: LetterReader, topic: str) -> int:
    return min(MOST_OFFSETS, max(1, _MOST_IN_ALL // max(1, reader.partitions[topic])))


def _cut_in_words(place: LetterPlace) -> str:
    return (
        f'{place.topic} was read for {_READING_S:g} s only, up to offset {place.offset} of '
        f'partition {place.partition}; ros2-kafka-bridge dead-letters list reads all'
    )


class _Listed:
    """What was read of a topic: of what is not shown, and of what strangers write, only so much.

    A letter may be a megabyte, its reason and where it was sent, too.
    """

    def __init__(self) -> None:
        self.places: set[LetterPlace] = set()
        self.marks: dict[LetterPlace, Mark] = {}
        self._newest: list[tuple[int, LetterPlace, Letter]] = []  # a heap, the oldest first

    def note(self, found: Letter | Mark) -> None:
        if isinstance(found, Mark):
            self.marks[found.letter] = found._replace(to=found.to[:_TOPIC_CHARS])
            return
        self.places.add(found.place)
        heapq.heappush(self._newest, (found.time_ms, found.place, _stripped(found)))
        if len(self._newest) > MOST_LETTERS:
            heapq.heappop(self._newest)

    def rows(self) -> list[Json]:
        newest_first = sorted(self._newest, reverse=True)
        return [_row(letter, self.marks.get(place)) for _, place, letter in newest_first]


def _stripped(letter: Letter) -> Letter:
    about = letter.about
    if about is not None:
        about = about._replace(reason=about.reason[: _REASON_CHARS + 1])
    return letter._replace(key=None, value=None, headers=[], about=about)


def _row(letter: Letter, mark: Mark | None) -> Json:
    about = letter.about
    return {
        'place': str(letter.place),
        'partition': letter.place.partition,
        'offset': letter.place.offset,
        'time_ms': letter.time_ms,
        'route': printable(about.route) if about else '',
        'source': printable(about.source) if about else '',
        'reason': _short(about.reason, _REASON_CHARS) if about else NOT_OURS,
        'bytes': letter.size_bytes,
        'replayed_to': printable(mark.to) if mark else '',
        'ours': about is not None,
    }


def look(config: Config, place: LetterPlace) -> Json | None:
    """Everything of a letter; None where it is gone.

    Raises:
        BridgeError: As for `newest`.
    """
    topic, partition, offset = place
    with open_reader(config) as reader:
        if not reader.has(topic) or partition >= reader.partitions[topic]:
            return None
        found = list(reader.fetch(topic, partition, {offset}))
    return _described(config, found[0]) if found else None


def _described(config: Config, letter: Letter) -> Json:
    about = letter.about
    return {
        **_row(letter, None),
        'reason': printable_lines(about.reason[:_SHOWN_BYTES]) if about else NOT_OURS,
        'failed_ms': about.time_ns // 1_000_000 if about else None,
        'to': printable(about.topic) if about and about.ros_topic else '',
        'key': _short(letter.key, _KEY_CHARS),
        'headers': [
            {'name': _short(name, _HEADER_CHARS), 'value': _short(value, _HEADER_CHARS)}
            for name, value in letter.headers
        ],
        'value': _value(letter),
        'fields': _fields(config, letter),
    }


def _short(text: str | bytes | None, chars: int) -> str | None:
    """The beginning of a text, escaped; a character of UTF-8 has four bytes at most."""
    return None if text is None else shortened(escaped(text[: 4 * chars + 4]), chars)


def _value(letter: Letter) -> Json:
    """The value as readable as its bytes are: JSON, text, or hex digits."""
    value = letter.value
    if value is None:
        left_out = letter.about is not None and letter.about.value_bytes is not None
        return {'kind': 'left out' if left_out else 'null', 'text': '', 'cut_bytes': 0}
    text = _pretty(value) if len(value) <= _SHOWN_BYTES else None
    if text is not None:
        return {'kind': 'JSON', 'text': text, 'cut_bytes': 0, 'base64': _base64(value)}
    is_text = _is_text(value)
    shown = value[: _SHOWN_BYTES if is_text else _HEX_BYTES]
    if is_text:
        text = printable_lines(shown.decode(errors='ignore'))
    else:
        text = '\n'.join(hex_lines(shown))
    kind = 'text' if is_text else 'bytes'
    cut = len(value) - len(shown)
    return {'kind': kind, 'text': text, 'cut_bytes': cut, 'base64': _base64(value)}


def _is_text(value: bytes) -> bool:
    try:
        return '\0' not in value.decode()
    except UnicodeDecodeError:
        return False


def _base64(value: bytes) -> str:
    """All of it, to be saved; empty where it is too large for a page."""
    return base64.b64encode(value).decode() if len(value) <= 1024 * 1024 else ''


def _pretty(value: bytes) -> str | None:
    try:
        found = json.loads(value)
        if not isinstance(found, dict | list):
            return None
        parts = json.JSONEncoder(indent=2, ensure_ascii=False).iterencode(found)
        text = _joined(parts, _FORMATTED_CHARS)
    except (ValueError, RecursionError):
        return None
    return None if text is None else printable_lines(text)


def _joined(parts: Iterable[str], most: int) -> str | None:
    """All parts; None where that is too much: a few bytes, nested deeply, indent to megabytes."""
    found, chars = [], 0
    for part in parts:
        found.append(part)
        chars += len(part)
        if chars > most:
            return None
    return ''.join(found)


def _fields(config: Config, letter: Letter) -> str:
    """The fields of the message, as JSON; empty where its route cannot read the value."""
    if letter.about is None or letter.value is None:
        return ''
    route = next((r for r in config.routes if r.name == letter.about.route), None)
    try:
        return _read(config, route, letter) if route else ''
    except BridgeError:  # that is why it is a dead letter
        return ''


def _read(config: Config, route: AnyRoute, letter: Letter) -> str:
    assert letter.value is not None, 'the caller has looked'
    if isinstance(route, KafkaToRosRoute):
        layout = _layout(config, route.type_name, NOT_SHOWN)
        cdr = decode_of(route, config, layout)(letter.value)
    elif letter.about and letter.about.reason.startswith('EncodeError:'):
        wanted = definition_of(letter)
        layout = _layout(config, letter.told('ros.type') or route.type_name or '', wanted)
        if wanted and layout.type_hash not in {None, *wanted}:
            return ''  # other fields than those that were written
        cdr = letter.value
    else:
        return ''
    data = make_encode(layout, Scope(''))(cdr)
    if len(data) <= _FORMATTED_BYTES:
        return printable_lines(msgspec.json.format(data, indent=2).decode())
    shown = printable_lines(data[:_SHOWN_BYTES].decode(errors='ignore'))
    return f'{shown}\n... {count(len(data) - _SHOWN_BYTES, "byte")} more'


def _layout(config: Config, name: str, wanted: Definitions) -> Layout:
    """What is known of a type without a node, which the page has not."""
    return make_layout(name, TypeSource.of(config.ros).describe(name, wanted))
