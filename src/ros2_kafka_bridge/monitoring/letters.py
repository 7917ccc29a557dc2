"""The dead letters of a bridge for its page: which there are, and what is in one."""

import base64
import json
from typing import Any, Final

import msgspec

from ros2_kafka_bridge.commands.dead_letters.report import NOT_OURS, open_reader, unseen_in_words
from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.config.settings import Config, KafkaToRosRoute
from ros2_kafka_bridge.dead_letters.letter import Letter, LetterPlace, Mark
from ros2_kafka_bridge.dead_letters.shown import escaped, hex_lines, shortened, text_lines
from ros2_kafka_bridge.errors import BridgeError
from ros2_kafka_bridge.formats.json import make_encode
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.logs.text import printable, printable_lines
from ros2_kafka_bridge.message_types import load_layout
from ros2_kafka_bridge.route.format import decode_of

MOST_OFFSETS: Final = 2000
MOST_LETTERS: Final = 500
_SHOWN_BYTES: Final = 64 * 1024
_HEX_BYTES: Final = 4096
_REASON_CHARS: Final = 500
_KEY_CHARS: Final = 200

Json = dict[str, Any]


def newest(config: Config, topic: str) -> Json:
    """The newest letters of a dead-letter topic, newest first.

    Raises:
        BridgeError: Kafka is away, or does not let this user read.
    """
    letters: list[Letter] = []
    marks: dict[LetterPlace, Mark] = {}
    with open_reader(config) as reader:
        there = reader.has(topic)
        for found in reader.newest(topic, MOST_OFFSETS) if there else ():
            if isinstance(found, Mark):
                marks[found.letter] = found
            else:
                letters.append(found._replace(value=None, headers=[]))
        unseen = [unseen_in_words(place) for place in reader.unseen.values()]
    letters.sort(key=lambda it: (it.time_ms, it.place), reverse=True)
    return {
        'topic': topic,
        'there': there,
        'seen': len(letters),
        'replayed': sum(letter.place in marks for letter in letters),
        'unseen': unseen,
        'letters': [_row(it, marks.get(it.place)) for it in letters[:MOST_LETTERS]],
    }


def _row(letter: Letter, mark: Mark | None) -> Json:
    about = letter.about
    return {
        'place': str(letter.place),
        'partition': letter.place.partition,
        'offset': letter.place.offset,
        'time_ms': letter.time_ms,
        'route': printable(about.route) if about else '',
        'source': printable(about.source) if about else '',
        'reason': shortened(printable(about.reason), _REASON_CHARS) if about else NOT_OURS,
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
        'reason': printable_lines(about.reason) if about else NOT_OURS,
        'failed_ms': about.time_ns // 1_000_000 if about else None,
        'to': printable(about.topic) if about and about.ros_topic else '',
        'key': None if letter.key is None else shortened(escaped(letter.key), _KEY_CHARS),
        'headers': [
            {'name': printable(name), 'value': None if value is None else escaped(value)}
            for name, value in letter.headers
        ],
        'value': _value(letter),
        'fields': _fields(config, letter),
    }


def _value(letter: Letter) -> Json:
    """The value as readable as its bytes are: JSON, text, or hex digits."""
    value = letter.value
    if value is None:
        left_out = letter.about is not None and letter.about.value_bytes is not None
        return {'kind': 'left out' if left_out else 'null', 'text': '', 'cut_bytes': 0}
    text = _pretty(value[: _SHOWN_BYTES + 1]) if len(value) <= _SHOWN_BYTES else None
    if text is not None:
        return {'kind': 'JSON', 'text': text, 'cut_bytes': 0, 'base64': _base64(value)}
    is_text = text_lines(value) is not None
    shown = value[: _SHOWN_BYTES if is_text else _HEX_BYTES]
    if is_text:
        text = printable_lines(shown.decode(errors='ignore'))
    else:
        text = '\n'.join(hex_lines(shown))
    kind = 'text' if is_text else 'bytes'
    cut = len(value) - len(shown)
    return {'kind': kind, 'text': text, 'cut_bytes': cut, 'base64': _base64(value)}


def _base64(value: bytes) -> str:
    """All of it, to be saved; empty where it is too large for a page."""
    return base64.b64encode(value).decode() if len(value) <= 1024 * 1024 else ''


def _pretty(value: bytes) -> str | None:
    try:
        found = json.loads(value)
        if not isinstance(found, dict | list):
            return None
        return printable_lines(json.dumps(found, indent=2, ensure_ascii=False))
    except (ValueError, RecursionError):
        return None


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
        layout = load_layout(route.sink.type, config.ros.message_path)
        cdr = decode_of(route, config, layout)(letter.value)
    elif letter.about and letter.about.reason.startswith('EncodeError:'):
        name = dict(letter.headers).get('ros.type') or route.source.type or ''
        text = name if isinstance(name, str) else name.decode(errors='replace')
        layout = load_layout(text, config.ros.message_path)
        cdr = letter.value
    else:
        return ''
    data = make_encode(layout, Scope(''))(cdr)
    return printable_lines(msgspec.json.format(data, indent=2).decode())
