"""The dead letters of a configuration: what `dead-letters list` and `show` print."""

import base64
import json
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from typing import Any, Final, NamedTuple

from rich.console import Console

from ros2_kafka_bridge.commands.screen import screen, show_line, show_table, waiting
from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.dead_letters.filter import LetterFilter, limited, read_index
from ros2_kafka_bridge.dead_letters.letter import Letter, LetterPlace, Mark
from ros2_kafka_bridge.dead_letters.shown import escaped, hex_lines, shortened, text_lines
from ros2_kafka_bridge.errors import BridgeError, ConfigError, TransportError
from ros2_kafka_bridge.kafka.letters import LetterReader
from ros2_kafka_bridge.kafka.overview import Overview
from ros2_kafka_bridge.kafka.properties import common_properties, consumer_properties
from ros2_kafka_bridge.logs.lines import keep_clients_quiet
from ros2_kafka_bridge.logs.text import count

NOT_OURS: Final = 'not a dead letter of a bridge'
_REASON_CHARS: Final = 100
_KEY_CHARS: Final = 30
_SHOWN_BYTES: Final = 4096
_NUMBERS: Final = re.compile(r'0x[0-9a-f]+|\d+')
_COLUMNS: Final = (
    'letter', 'when', 'route', 'source', 'reason', 'key', '#bytes', 'replayed',
)  # fmt: skip


class LetterQuery(NamedTuple):
    """Which dead letters are asked for.

    Args:
        topic: The dead-letter topic; empty for those of the configuration.
    """

    config: Config
    topic: str
    filter: LetterFilter

    def topics(self) -> list[str]:
        """The dead-letter topics to look at."""
        if self.topic:
            return [self.topic]
        routes = self.config.routes
        named = [r.dead_letter_topic for r in routes if r.name == self.filter.route]
        return list(dict.fromkeys(named or [r.dead_letter_topic for r in routes]))


class Found(NamedTuple):
    """What was found.

    Args:
        missing: Dead-letter topics that are not there.
        unseen: From where on a partition could not be read: a transaction there has not ended.
    """

    letters: list[Letter]
    marks: dict[LetterPlace, Mark]
    missing: list[str]
    unseen: list[LetterPlace]


def spoken(command: Callable[[], int]) -> int:
    """Run a command; what fails on the way is said in a sentence, with the exit status 1."""
    keep_clients_quiet()
    try:
        return command()
    except ConfigError:
        raise
    except BridgeError as error:
        print(escaped(str(error)), file=sys.stderr)  # noqa: T201 (the words for the user)
        return 1


def list_letters(query: LetterQuery, *, as_json: bool) -> int:
    """Print a line for each letter, and how many there are of each kind."""
    found = find(query)
    if as_json:
        sys.stdout.write(json.dumps(_json(found), indent=2) + '\n')
        return 0
    console = screen()
    if not found.letters:
        show_line(console, none_there(query, found))
        return 0
    rows = [_row(letter, found.marks.get(letter.place)) for letter in found.letters]
    show_table(console, 'Dead letters', _COLUMNS, [[[cell] for cell in row] for row in rows])
    _show_summary(console, found)
    for place in found.unseen:
        show_line(console, unseen_in_words(place))
    return 0


def show_letters(query: LetterQuery, *, raw: bool) -> int:
    """Print everything of the letters that are meant, or the bytes of one value.

    Raises:
        ConfigError: There is no such letter, or several for `raw`.
        TransportError: There is none that can be seen now.
    """
    found = find(query)
    if not found.letters:
        raise no_such_letter(query, found)
    if raw and len(found.letters) > 1:
        text = f'--raw writes one value, and {len(found.letters)} letters fit: name one'
        raise ConfigError([f'{text}, such as {found.letters[0].place}'])
    with open_reader(query.config) as reader:
        for known in found.letters:
            for letter in reader.fetch(*known.place[:2], {known.place.offset}):
                if raw:
                    sys.stdout.buffer.write(letter.value or b'')
                else:
                    for line in described(letter, found.marks.get(letter.place)):
                        show_line(screen(), line)
    return 0


def find(query: LetterQuery) -> Found:
    """Look at the topics for what is asked for.

    Raises:
        BridgeError: Kafka is away, or does not let this user read.
    """
    letters: list[Letter] = []
    marks: dict[LetterPlace, Mark] = {}
    missing = []
    with open_reader(query.config) as reader, waiting('Reading the dead letters'):
        for topic in query.topics():
            if not reader.has(topic):
                missing.append(topic)
                continue
            index = read_index(reader.letters(topic, query.filter.since_ms), query.filter)
            letters += index.letters
            marks |= index.marks
        unseen = list(reader.unseen.values())
    return Found(list(limited(letters, query.filter.limit)), marks, missing, unseen)


def open_reader(config: Config) -> LetterReader:
    """Make what reads the dead-letter topics of a cluster; `with` opens it."""
    group = f'{config.name}.dead-letters'
    return LetterReader(
        consumer_properties(config.kafka, group=group, client_id=config.name),
        Overview(common_properties(config.kafka, client_id=config.name)),
    )


def none_there(query: LetterQuery, found: Found) -> str:
    """Say that there are none, and where was looked."""
    if query.filter.offset is not None:
        place = f' at offset {query.filter.offset}'
    else:
        place = ' that fit' if query.filter.is_narrow else ''
    there = [topic for topic in query.topics() if topic not in found.missing]
    looked = [f'looked at {", ".join(there)}'] * bool(there)
    looked += [f'{", ".join(found.missing)}: not there'] * bool(found.missing)
    looked += map(unseen_in_words, found.unseen)
    seen = ' seen' * bool(found.unseen)
    return f'no dead letters{seen}{place} ({"; ".join(looked)})'


def no_such_letter(query: LetterQuery, found: Found) -> ConfigError | TransportError:
    """What is wrong where none is found, though one was named: it may only be hidden."""
    text = none_there(query, found)
    return TransportError(text) if found.unseen else ConfigError([text])


def unseen_in_words(place: LetterPlace) -> str:
    """Say that a partition was not read to its end."""
    return (
        f'{place.topic}[{place.partition}] is not seen from offset {place.offset} on, neither '
        'letters nor marks of replays: a transaction there has not ended; try again in a minute'
    )


def when(time_ms: int) -> str:
    """A time, in the zone of this machine."""
    if not 0 < time_ms < 253_402_300_799_000:
        return '-'
    moment = datetime.fromtimestamp(time_ms / 1000, UTC).astimezone()
    return moment.isoformat(sep=' ', timespec='milliseconds')


def described(letter: Letter, mark: Mark | None) -> Iterator[str]:
    """Everything of a letter, in lines."""
    yield str(letter.place)
    about = letter.about
    yield f'  when      {when(letter.time_ms)}'
    if about is None:
        yield f'  reason    {NOT_OURS}'
    else:
        yield f'  route     {escaped(about.route)}'
        to = f' -> {escaped(about.topic)}' if about.ros_topic else ''
        yield f'  source    {escaped(about.source)}{to}'
        yield f'  reason    {escaped(about.reason)}'
        yield f'  failed    {when(about.time_ns // 1_000_000)}'
        yield f'  replayed  {_replayed_in_full(mark)}'
    yield f'  key       {"null" if letter.key is None else escaped(letter.key)}'
    yield f'  headers   {len(letter.headers)}'
    for name, value in letter.headers:
        yield f'    {escaped(name)} = {"null" if value is None else escaped(value)}'
    yield from _value_lines(letter)


def _value_lines(letter: Letter) -> Iterator[str]:
    value = letter.value
    if value is None:
        left_out = letter.about is not None and letter.about.value_bytes is not None
        told = f'left out ({letter.size_bytes} bytes)' if left_out else 'null'
        yield f'  value     {told}'
        return
    shown = value[:_SHOWN_BYTES]
    lines = text_lines(value)
    kind = 'not UTF-8' if lines is None else 'text'
    yield f'  value     {count(len(value), "byte")}, {kind}'
    cut = shown.decode(errors='ignore').split('\n')
    for line in hex_lines(shown) if lines is None else map(escaped, cut):
        yield f'    {line}'
    if len(value) > len(shown):
        yield f'    ... {count(len(value) - len(shown), "byte")} more: --raw writes all'


def _row(letter: Letter, mark: Mark | None) -> Sequence[str]:
    about = letter.about
    key = '-' if letter.key is None else shortened(escaped(letter.key), _KEY_CHARS)
    told = ('-', '-', NOT_OURS)
    if about is not None:
        reason = shortened(escaped(about.reason), _REASON_CHARS)
        told = (escaped(about.route), escaped(about.source), reason)
    replayed = f'to {escaped(mark.to)}' if mark else 'no'
    return (str(letter.place), when(letter.time_ms), *told, key, str(letter.size_bytes), replayed)


def _replayed_in_full(mark: Mark | None) -> str:
    return f'to {escaped(mark.to)} at {when(mark.time_ns // 1_000_000)}' if mark else 'no'


def _kind(letter: Letter) -> tuple[str, str]:
    """Route and reason, without the numbers that differ from letter to letter."""
    if letter.about is None:
        return '-', NOT_OURS
    reason = shortened(_NUMBERS.sub('#', escaped(letter.about.reason)), _REASON_CHARS)
    return escaped(letter.about.route), reason


def _summary(found: Found) -> list[tuple[str, str, int, int]]:
    total = Counter(_kind(letter) for letter in found.letters)
    replayed = Counter(_kind(letter) for letter in found.letters if letter.place in found.marks)
    return [(*kind, number, replayed[kind]) for kind, number in total.most_common()]


def _show_summary(console: Console, found: Found) -> None:
    rows = [
        [[route], [reason], [str(number)], [str(replayed)]]
        for route, reason, number, replayed in _summary(found)
    ]
    title = count(len(found.letters), 'dead letter')
    show_table(console, title, ['route', 'reason', '#letters', '#replayed'], rows)


def _json(found: Found) -> dict[str, Any]:
    keys = ('route', 'reason', 'letters', 'replayed')
    return {
        'letters': [
            _letter_json(letter, found.marks.get(letter.place)) for letter in found.letters
        ],
        'summary': [dict(zip(keys, row, strict=True)) for row in _summary(found)],
        'missing_topics': found.missing,
        'unseen': [place._asdict() for place in found.unseen],
    }


def _letter_json(letter: Letter, mark: Mark | None) -> dict[str, Any]:
    about = letter.about
    key = None if letter.key is None else base64.b64encode(letter.key).decode()
    told: dict[str, Any] = {
        **letter.place._asdict(),
        'time_ms': letter.time_ms,
        'key': None if letter.key is None else escaped(letter.key),
        'key_base64': key,
        'bytes': letter.size_bytes,
        'ours': about is not None,
        'replayed': mark and {'to': mark.to, 'time_ns': mark.time_ns},
    }
    return told if about is None else told | {'about': about._asdict()}
