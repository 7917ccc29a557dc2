"""What is a dead letter, which are meant, and how what others have written is shown."""

from datetime import UTC, datetime, timedelta

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.bridges.made_letters import (
    HEADERS,
    TOPIC,
    kafka_letter,
    read,
    restorer,
    ros_letter,
    stored,
)

from ros2_kafka_bridge.dead_letters.filter import LetterFilter, limited, read_index, time_ms
from ros2_kafka_bridge.dead_letters.letter import Letter, LetterPlace, Mark, mark, parse
from ros2_kafka_bridge.dead_letters.shown import escaped, hex_lines, shortened, text_lines
from ros2_kafka_bridge.dead_letters.writer import without_value
from ros2_kafka_bridge.endpoints import HeaderList, Outgoing
from ros2_kafka_bridge.errors import ConfigError, RecordError

NOW = datetime(2026, 1, 31, 12, tzinfo=UTC)


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
    found = parse(TOPIC, stored(mark(place, 'orders')))
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
        *[
            [(n, value if n == f'dead_letter.{name}' else v) for n, v in kafka_letter().headers]
            for name in ('topic', 'route')
            for value in ('x' * 256, 'x' * 500_000)
        ],
        [(n, '' if n == 'dead_letter.topic' else v) for n, v in kafka_letter().headers],
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
    found = parse(TOPIC, stored(Outgoing(TOPIC, None, None, headers)))
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
