"""Dead letters without a broker: what is one, which are meant, what is sent for one."""

import base64
import struct
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from ros2_kafka_bridge.cli import app
from ros2_kafka_bridge.commands.dead_letters.replay_ros import Channel
from ros2_kafka_bridge.commands.dead_letters.report import _letter_json, described
from ros2_kafka_bridge.commands.dead_letters.restore import Again, Restorer
from ros2_kafka_bridge.config.settings import Config, KafkaToRosRoute
from ros2_kafka_bridge.dead_letters.filter import LetterFilter, limited, read_index, time_ms
from ros2_kafka_bridge.dead_letters.letter import Letter, LetterPlace, Mark, mark, parse
from ros2_kafka_bridge.dead_letters.shown import escaped, hex_lines, shortened, text_lines
from ros2_kafka_bridge.dead_letters.writer import explain, from_kafka, from_ros, without_value
from ros2_kafka_bridge.endpoints import HeaderList, Load, Matches, Outgoing, Readers
from ros2_kafka_bridge.errors import (
    ConfigError,
    DecodeError,
    EncodeError,
    RecordError,
    TransportError,
)
from ros2_kafka_bridge.kafka import letters, overview
from ros2_kafka_bridge.threads.stop import Stop

TOPIC = 'orders.dead-letters'
NOW = datetime(2026, 1, 31, 12, tzinfo=UTC)
HEADERS: HeaderList = [('trace', b'\xff'), ('trace', None)]
CONFIG: dict[str, Any] = {
    'name': 'warehouse-1',
    'kafka': {'bootstrap.servers': 'localhost:9092'},
    'routes': [
        {
            'name': 'orders',
            'from': {'kafka': 'orders'},
            'to': {'ros': '/orders', 'type': 'std_msgs/msg/String'},
            'format': 'text',
            'max_message_bytes': 100,
        },
        {
            'name': 'returned',
            'from': {'ros': '/orders'},
            'to': {'kafka': 'returned', 'key': '{ros.gid} {message.data}'},
            'format': 'text',
        },
    ],
}


class Stored(NamedTuple):
    """A record as Kafka's client hands it over."""

    record: Outgoing
    at: int = 7
    time: int = 1_000_000

    def partition(self) -> int:
        return 0

    def offset(self) -> int:
        return self.at

    def key(self) -> bytes | None:
        return self.record.key

    def value(self) -> bytes | None:
        return self.record.value

    def headers(self) -> HeaderList | None:
        found = self.record.headers
        return [(n, v.encode() if isinstance(v, str) else v) for n, v in found] or None

    def timestamp(self) -> tuple[int, int]:
        return 1, self.time


def kafka_letter(
    value: bytes | None = b'order', headers: HeaderList = HEADERS, topic: str = 'orders'
) -> Outgoing:
    record = Outgoing(topic, b'key', value, headers)
    return explain(record, DecodeError('not UTF-8 at byte 3'), from_kafka('orders', topic, 2, 5))


def ros_letter(value: bytes | None, error: RecordError | None = None) -> Outgoing:
    told: HeaderList = [('ros.type', 'std_msgs/msg/String'), ('ros.gid', 'ab' * 16)]
    record = Outgoing('returned', None, value, told)
    origin = from_ros('returned', '/orders', 'returned')
    return explain(record, error or EncodeError('data: a NUL'), origin)


def read(record: Outgoing, at: int = 7, time: int = 1_000_000) -> Letter:
    found = parse(TOPIC, Stored(record, at, time))
    assert isinstance(found, Letter)
    return found


def config(**changes: Any) -> Config:
    routes = [{**route, **changes} for route in CONFIG['routes']]
    return Config.model_validate({**CONFIG, 'routes': routes})


def restorer(
    of: Config | None = None,
    original: Outgoing | None = None,
    partitions: Mapping[str, int] | None = None,
    *,
    force: bool = False,
) -> Restorer:
    known = {'orders': 3, 'returned': 1, TOPIC: 1} if partitions is None else partitions
    fetched = None if original is None else Stored(original)
    return Restorer(of or config(), known, lambda *_: fetched, force=force)


# What is a letter


def test_a_letter_is_read_as_the_bridge_has_written_it() -> None:
    letter = read(kafka_letter())
    assert str(letter.place) == 'orders.dead-letters[0]@7'
    assert LetterPlace.parse(str(letter.place)) == letter.place
    assert (letter.key, letter.value, letter.headers) == (b'key', b'order', HEADERS)
    assert letter.about is not None
    assert letter.about.reason == 'DecodeError: not UTF-8 at byte 3'
    assert (letter.about.route, letter.about.source) == ('orders', 'orders[2]@5')
    assert letter.about.value_bytes is None


def test_a_letter_from_ros_names_the_ros_topic() -> None:
    letter = read(ros_letter(b'cdr'))
    assert letter.about is not None
    assert (letter.about.source, letter.about.topic) == ('/orders', 'returned')


def test_a_value_left_out_counts_with_its_size() -> None:
    letter = read(without_value(kafka_letter(b'12345')))
    assert (letter.value, letter.size_bytes) == (None, 5)


def test_headers_that_a_record_brought_along_are_its_own_and_say_nothing() -> None:
    forged = kafka_letter(topic='secret').headers
    letter = read(kafka_letter(headers=[*HEADERS, *forged]))
    assert letter.about is not None
    assert letter.about.topic == 'orders'
    assert letter.headers == [
        (n, v.encode() if isinstance(v, str) else v) for n, v in [*HEADERS, *forged]
    ]


def test_a_mark_is_read_again_and_names_its_letter() -> None:
    place = LetterPlace(TOPIC, 0, 3)
    found = parse(TOPIC, Stored(mark(place, 'orders')))
    assert isinstance(found, Mark)
    assert (found.letter, found.to) == (place, 'orders')


def test_a_letter_with_the_headers_of_a_mark_before_its_own_is_a_letter() -> None:
    record = kafka_letter(headers=mark(LetterPlace(TOPIC, 0, 3), 'orders').headers)
    assert read(record).about is not None


@pytest.mark.parametrize(
    'headers',
    [
        [],
        HEADERS,
        [('dead_letter.error', b'\n')],
        [h for h in kafka_letter().headers if h[0] != 'dead_letter.offset'],
        [*kafka_letter().headers, ('trace', b'behind')],
        [*kafka_letter().headers, ('dead_letter.source', b'/both')],
        [*kafka_letter().headers, ('dead_letter.topic', b'twice')],
        [(n, b'9' * 99 if n == 'dead_letter.offset' else v) for n, v in kafka_letter().headers],
        mark(LetterPlace(TOPIC, 0, 9), 'of a letter that is still to come').headers,
    ],
)
def test_what_no_bridge_has_written_is_no_letter_of_one_and_never_replayed(
    headers: HeaderList,
) -> None:
    letter = read(Outgoing(TOPIC, b'\x1b', b'x', headers))
    assert letter.about is None
    with pytest.raises(RecordError, match='no dead letter of a bridge'):
        restorer(force=True).for_kafka(letter)


@given(st.lists(st.tuples(st.sampled_from(['dead_letter.error', 'dead_letter.offset',
    'dead_letter.replayed', 'dead_letter.to', 'dead_letter.time_ns', 'x']),
    st.one_of(st.none(), st.binary(max_size=8)))))  # fmt: skip
def test_no_headers_confuse_the_reading(headers: HeaderList) -> None:
    found = parse(TOPIC, Stored(Outgoing(TOPIC, None, None, headers)))
    assert found.place.offset == 7 if isinstance(found, Letter) else found.letter.offset < 7


# Which letters are meant


@pytest.mark.parametrize(
    ('letter_filter', 'fits'),
    [
        (LetterFilter(), True),
        (LetterFilter(route='orders'), True),
        (LetterFilter(route='order'), False),
        (LetterFilter(reason='not UTF-8'), True),
        (LetterFilter(reason='^DecodeError: .* byte [0-9]$'), True),
        (LetterFilter(reason='DecodeError'), True),
        (LetterFilter(reason='EncodeError'), False),
        (LetterFilter(reason='(not UTF-8'), False),
        (LetterFilter(since_ms=1_000_000), True),
        (LetterFilter(since_ms=1_000_001), False),
        (LetterFilter(until_ms=1_000_000), False),
        (LetterFilter(until_ms=1_000_001), True),
        (LetterFilter(partition=0, offset=7), True),
        (LetterFilter(partition=1), False),
        (LetterFilter(offset=8), False),
    ],
)
def test_filters(letter_filter: LetterFilter, *, fits: bool) -> None:
    assert letter_filter.fits(read(kafka_letter())) == fits
    assert letter_filter.is_narrow == (letter_filter != LetterFilter())


def test_an_index_keeps_the_letters_that_fit_without_values_and_every_mark() -> None:
    letters = read(kafka_letter(), 1, 10), read(kafka_letter(), 2, 99)
    found: list[Letter | Mark] = [*letters, Mark(LetterPlace(TOPIC, 0, 1), 'orders', 5)]
    index = read_index(found, LetterFilter(until_ms=50))
    [letter] = index.letters
    assert (letter.place.offset, letter.value, letter.headers) == (1, None, [])
    assert letter.size_bytes == len(b'order')
    assert LetterPlace(TOPIC, 0, 1) in index.marks
    assert len(list(limited(index.letters * 5, 3))) == 3


@pytest.mark.parametrize(
    ('text', 'age'),
    [
        ('90s', timedelta(seconds=90)),
        ('30m', timedelta(minutes=30)),
        ('2h', timedelta(hours=2)),
        ('1.5 d', timedelta(days=1.5)),
        ('1w', timedelta(weeks=1)),
        ('2026-01-31T11:00:00Z', timedelta(hours=1)),
        ('2026-01-31T12:00:00+01:00', timedelta(hours=1)),
    ],
)
def test_a_time_is_an_age_or_iso(text: str, age: timedelta) -> None:
    assert time_ms(text, '--since', NOW) == int((NOW - age).timestamp() * 1000)


def test_what_is_no_time_is_refused_with_an_example() -> None:
    assert time_ms('', '--since', NOW) is None
    assert time_ms('999999999w', '--since', NOW) == 0
    with pytest.raises(ConfigError, match=r'--since: .soon. is not a time such as'):
        time_ms('soon', '--since', NOW)


# What is sent


def test_a_letter_of_a_type_in_a_folder_is_checked_without_its_package() -> None:
    folder = Path(__file__).parents[3] / 'examples' / 'msgs'
    route = CONFIG['routes'][0] | {
        'to': {'ros': '/scans', 'type': 'shelf_msgs/msg/ShelfScan'},
        'format': 'json',
        'json': {'missing': 'default'},
    }
    folders = {'message_path': [str(folder)]}
    made = Config.model_validate(CONFIG | {'ros': folders, 'routes': [route]})
    assert restorer(made).for_kafka(read(kafka_letter(b'{"side": 1}'))).record.topic == 'orders'
    with pytest.raises(RecordError, match=r'would fail again: DecodeError: \$.side: expected int'):
        restorer(made).for_kafka(read(kafka_letter(b'{"side": "left"}')))


def test_a_letter_of_another_version_of_its_type_would_fail_again() -> None:
    told: HeaderList = [('ros.type_hash', b'RIHS01_' + b'0' * 64)]
    with pytest.raises(RecordError, match=r'would fail again: DecodeError: ros\.type_hash'):
        restorer().for_kafka(read(kafka_letter(headers=told)))
    route = CONFIG['routes'][0] | {'check_type_hash': False}
    unchecked = Config.model_validate(CONFIG | {'routes': [route]})
    passed = restorer(unchecked).for_kafka(read(kafka_letter(headers=told)))
    assert passed.record.value == b'order'


def test_a_record_goes_back_as_it_was_to_its_topic_and_partition() -> None:
    again = restorer().for_kafka(read(kafka_letter()))
    assert again.record == Outgoing('orders', b'key', b'order', HEADERS)
    assert again.partition == 2
    assert again.cdr is not None


def test_a_partition_that_is_no_longer_there_is_left_to_the_key() -> None:
    again = restorer(partitions={'orders': 2}).for_kafka(read(kafka_letter()))
    assert again.partition is None


def test_an_origin_that_makes_this_bridge_skip_it_is_left_out_and_no_other() -> None:
    origins: HeaderList = [('bridge.origin', b'warehouse-1'), ('bridge.origin', b'warehouse-2')]
    again = restorer().for_kafka(read(kafka_letter(headers=origins)))
    assert again.record.headers == [('bridge.origin', b'warehouse-2')]


@pytest.mark.parametrize('value', [b'\xff', b'a\0b', None, b'x' * 101])
def test_what_would_fail_again_is_left_unless_forced(value: bytes | None) -> None:
    letter = read(kafka_letter(value))
    for attempt in (restorer().for_kafka, restorer().for_ros):
        with pytest.raises(RecordError, match='would fail again: '):
            attempt(letter)
    again = restorer(force=True).for_kafka(letter)
    assert (again.record.value, again.cdr) == (value, None)


def test_a_topic_that_no_route_reads_needs_force_and_must_be_there() -> None:
    letter = read(kafka_letter(topic='other'))
    with pytest.raises(RecordError, match=r'no route of the file reads other: .* --force'):
        restorer().for_kafka(letter)
    with pytest.raises(RecordError, match='the topic other is not there'):
        restorer(force=True).for_kafka(letter)
    assert restorer(partitions={'other': 1}, force=True).for_kafka(letter).route is None


def test_a_letter_never_goes_back_to_its_own_dead_letter_topic() -> None:
    with pytest.raises(RecordError, match='its own dead-letter topic'):
        restorer(force=True).for_kafka(read(kafka_letter(topic=TOPIC)))


def test_a_value_left_out_is_fetched_if_the_same_record_is_still_there() -> None:
    letter = read(without_value(kafka_letter()))
    original = Outgoing('orders', b'key', b'order', HEADERS)
    assert restorer(original=original).for_kafka(letter).record == original
    other = original._replace(value=b'other order')
    for gone in (None, other, original._replace(key=b'another')):
        with pytest.raises(
            RecordError, match=r'\(5 bytes\) was left out, and orders\[2\]@5 is no'
        ):
            restorer(original=gone).for_kafka(letter)


def test_a_bare_letter_gets_key_and_headers_from_the_record_that_it_came_from() -> None:
    record = without_value(kafka_letter(headers=[]))._replace(key=None)
    original = Outgoing('orders', b'key', b'order', HEADERS)
    assert restorer(original=original).for_kafka(read(record)).record == original


def string(text: bytes) -> bytes:
    return b'\0\1\0\0' + struct.pack('<I', len(text) + 1) + text + b'\0'


def test_a_message_of_ros_is_encoded_again_with_the_key_of_the_route() -> None:
    again = restorer().for_kafka(read(ros_letter(string(b'hello'))))
    assert again.record.topic == 'returned'
    assert (again.record.key, again.record.value) == (b'ab' * 16 + b' hello', b'hello')
    assert ('ros.gid', b'ab' * 16) in again.record.headers


def test_what_was_encoded_and_refused_by_kafka_goes_as_it_was() -> None:
    letter = read(ros_letter(b'hello', RecordError('topic returned: refused')))
    assert restorer().for_kafka(letter).record.value == b'hello'


def test_messages_of_ros_that_cannot_be_replayed_say_why() -> None:
    broken = read(ros_letter(b'garbage'))
    lost = read(without_value(ros_letter(string(b'hello'))))
    fine = read(ros_letter(string(b'hello')))
    for letter, to, reason in (
        (broken, restorer(force=True).for_kafka, 'would fail again: EncodeError'),
        (lost, restorer().for_kafka, 'nothing holds it any more'),
        (fine, restorer().for_ros, 'can be replayed to Kafka only'),
    ):
        with pytest.raises(RecordError, match=reason):
            to(letter)


def test_a_route_with_a_new_name_takes_the_letters_of_the_old_one() -> None:
    data = {**CONFIG, 'routes': [{**CONFIG['routes'][0], 'name': 'renamed'}]}
    again = restorer(Config.model_validate(data)).for_kafka(read(kafka_letter()))
    assert again.route is not None
    assert again.route.name == 'renamed'
    assert isinstance(again, Again)


# What is shown


@given(st.one_of(st.text(), st.binary()))
def test_nothing_that_steers_a_terminal_is_ever_shown(content: str | bytes) -> None:
    assert escaped(content).isprintable()


def test_escapes_are_readable() -> None:
    assert escaped(b'caf\xc3\xa9 \xff\x1b[2J\n\\') == 'café \\xff\\x1b[2J\\n\\\\'
    assert escaped('\u202e') == '\\u202e'
    assert shortened('12345', 5) == '12345'
    assert shortened('123456', 5) == '12...'


def test_values_are_shown_as_text_or_as_a_hex_dump() -> None:
    assert text_lines(b'a\x1b\nb') == ['a\\x1b', 'b']
    assert text_lines(b'\xff') is None
    assert list(hex_lines(bytes(range(0x3C, 0x4E)))) == [
        '00000000  3c 3d 3e 3f 40 41 42 43 44 45 46 47 48 49 4a 4b  <=>?@ABCDEFGHIJK',
        '00000010  4c 4d                                            LM',
    ]


def test_everything_of_a_letter_is_shown_and_a_long_value_is_cut() -> None:
    shown = '\n'.join(described(read(kafka_letter(b'x' * 5000)), None))
    for line in ('route     orders', 'source    orders[2]@5', 'key       key', 'trace = \\xff'):
        assert f'  {line}' in shown
    assert 'trace = null' in shown
    assert '... 904 bytes more: --raw writes all' in shown
    left_out = '\n'.join(described(read(without_value(kafka_letter())), None))
    assert 'value     left out (5 bytes)' in left_out
    assert 'value     null' in '\n'.join(described(read(kafka_letter(None)), None))
    odd = '\n'.join(described(read(kafka_letter(b'\xffA')), None))
    assert 'value     2 bytes, not UTF-8' in odd
    assert '00000000  ff 41' in odd


# Straight to ROS


class Sink:
    """Readers that acknowledge at once, and may be lost once."""

    load = Load()
    matches = Matches()
    holders = ()

    def __init__(self, matched: int = 1, lost_at: int = 0) -> None:
        self.published: list[bytes] = []
        self.matched = self.come = matched
        self.lost_at = lost_at
        self.since = 0

    def open(self) -> None:
        pass

    def publish(self, cdr: bytes) -> bool:
        self.published.append(cdr)
        return True

    def readers(self) -> Readers:
        if self.lost_at and len(self.published) >= self.lost_at:
            self.since, self.lost_at = len(self.published), 0
            self.come += 1  # another one in its place
            return Readers(self.matched, self.come, lost=True, confirmed=0)
        confirmed = len(self.published) - self.since
        return Readers(self.matched, self.come, lost=False, confirmed=confirmed)

    def close(self) -> None:
        pass


def channel(sink: Sink, stop: Stop | None = None) -> Channel:
    route = config().routes[0]
    assert isinstance(route, KafkaToRosRoute)
    return Channel(route, sink, stop or Stop())


def test_batches_are_published_and_waited_for_one_after_the_other() -> None:
    sink = Sink()
    to = channel(sink)
    to.deliver([b'1', b'2'])
    to.deliver([b'3'])
    assert sink.published == [b'1', b'2', b'3']


def test_when_a_reader_goes_the_batch_is_published_again() -> None:
    sink = Sink(lost_at=3)
    to = channel(sink)
    to.deliver([b'1'])
    to.deliver([b'2', b'3'])
    to.deliver([b'4'])
    assert sink.published == [b'1', b'2', b'3', b'2', b'3', b'4']


def test_a_stop_ends_the_waiting_for_subscribers() -> None:
    stop, sink = Stop(), Sink(matched=0)
    stop.ask()
    with pytest.raises(TransportError, match='stopped while waiting'):
        channel(sink, stop).deliver([b'1'])
    assert sink.published == []


# The command line


def invoke(place: Path, *arguments: str) -> tuple[int, str]:
    file = place / 'bridge.yaml'
    file.write_text(
        'name: test\nkafka: {bootstrap.servers: "127.0.0.1:1"}\nroutes:\n'
        '  - {name: orders, from: {kafka: orders}, format: text,\n'
        '     to: {ros: /orders, type: std_msgs/msg/String}}\n'
    )
    command, *rest = arguments
    result = CliRunner().invoke(app, ['dead-letters', command, str(file), *rest])
    if isinstance(result.exception, ConfigError):
        return 2, str(result.exception)
    return result.exit_code, result.output


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['replay'], 'which letters? Give a filter such as --route or --since, or --all'),
        (['replay', '--all', '--to', 'ros', '--force'], '--force goes with --to kafka only'),
        (['list', '--since', 'soon'], "--since: 'soon' is not a time"),
        (['show', 'nonsense'], "'nonsense' is no letter: one is written as"),
        (['show', 'a[0]@1', '--offset', '2'], 'name two letters'),
        (['replay', '--to', 'mars'], "'mars' is not one of"),
    ],
)
def test_a_wrong_use_is_said_before_anybody_is_asked(
    tmp_path: Path, arguments: Sequence[str], words: str
) -> None:
    status, output = invoke(tmp_path, *arguments)
    assert status == 2
    assert words in output


@pytest.mark.parametrize('arguments', [['list'], ['show', 'a[0]@1'], ['replay', '--all']])
def test_a_broker_that_is_not_there_is_said_in_a_sentence(
    tmp_path: Path, arguments: Sequence[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (letters, overview):
        monkeypatch.setattr(module, '_REQUEST_S', 0.5)
    status, output = invoke(tmp_path, *arguments)
    assert status == 1
    assert 'the broker does not answer' in output
    assert 'Traceback' not in output


def test_json_keeps_the_bytes_of_a_key() -> None:
    told = _letter_json(read(kafka_letter()), None)
    assert base64.b64decode(told['key_base64']) == b'key'
    assert told['about']['offset'] == 5
