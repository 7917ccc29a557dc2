"""W3C trace context: what is read, what is written."""

import itertools
import re

import pytest
from hypothesis import example, given, strategies

from ros2_kafka_bridge.endpoints import HeaderList
from ros2_kafka_bridge.route.trace_context import TraceContext, from_headers, parse, traceparents

TRACE, SPAN = '4bf92f3577b34da6a3ce929d0e0e4736', '00f067aa0ba902b7'
GOOD = f'00-{TRACE}-{SPAN}-01'


def hexes(length: int) -> strategies.SearchStrategy[str]:
    return strategies.text('0123456789abcdef', min_size=length, max_size=length)


@given(hexes(32), hexes(16), hexes(2), strategies.sampled_from(['text', 'bytes']))
@example('0' * 32, '1' * 16, '01', 'text')
@example('1' * 32, '0' * 16, '01', 'bytes')
def test_what_the_first_version_says_is_read(trace: str, span: str, flags: str, kind: str) -> None:
    text = f'00-{trace}-{span}-{flags}'
    found = parse(text.encode() if kind == 'bytes' else text)
    if set(trace) == {'0'} or set(span) == {'0'}:
        assert found is None
    else:
        assert found == TraceContext(trace, span, sampled=int(flags, 16) % 2 == 1)


@given(hexes(2), strategies.binary())
def test_a_version_to_come_may_say_more_behind_a_dash(version: str, more: bytes) -> None:
    start = f'{version}-{TRACE}-{SPAN}-01'.encode()
    expected = None if version == 'ff' else TraceContext(TRACE, SPAN, sampled=True)
    assert parse(start) == expected
    assert parse(start + b'-' + more) == (None if version == '00' else expected)


@given(strategies.binary() | strategies.text() | strategies.none())
def test_anything_else_is_no_context_and_no_error(value: bytes | str | None) -> None:
    assert parse(value) is None


@pytest.mark.parametrize(
    'wrong',
    [
        GOOD.upper(),
        GOOD[:-1],
        GOOD + '0',
        GOOD + '-',
        f' {GOOD}',
        f'{GOOD}\n',
        GOOD.replace('-', '_'),
        GOOD.replace('b', 'g'),
        f'01-{TRACE}-{SPAN}-01x',
        f'0-{TRACE}-{SPAN}-01',
        f'00-{TRACE[:-1]}-{SPAN}-01',
        f'00-{TRACE}-{SPAN}0-01',
        f'00-{TRACE}-{SPAN}-1',
        f'00-{TRACE}-{SPAN}',
    ],
)
def test_what_the_standard_forbids_is_no_context(wrong: str) -> None:
    assert parse(GOOD) is not None
    assert parse(wrong) is None


@pytest.mark.parametrize(
    ('headers', 'state'),
    [
        ([('traceparent', GOOD.encode())], ''),
        ([('TraceParent', GOOD)], ''),
        ([('a', b'1'), ('tracestate', b'x=1'), ('traceparent', GOOD)], 'x=1'),
        ([('traceparent', GOOD), ('tracestate', b'x=1'), ('tracestate', 'y=2')], 'x=1,y=2'),
        ([('traceparent', GOOD), ('tracestate', b'\xff')], ''),
        ([('traceparent', GOOD), ('tracestate', b'x=' + b'1' * 5000)], ''),
        ([('traceparent', GOOD), ('tracestate', None)], ''),
    ],
)
def test_the_context_of_a_record_is_found_among_its_headers(
    headers: HeaderList, state: str
) -> None:
    assert from_headers(headers) == TraceContext(TRACE, SPAN, sampled=True, state=state)


@pytest.mark.parametrize(
    'headers',
    [
        [],
        [('tracestate', b'x=1')],
        [('traceparent', None)],
        [('traceparent', GOOD), ('traceparent', GOOD)],
        [('traceparent', b'00-0-0-01'), ('tracestate', b'x=1')],
    ],
)
def test_a_record_without_a_valid_context_has_none(headers: HeaderList) -> None:
    assert from_headers(headers) is None


def test_every_new_trace_has_ids_of_its_own_and_the_form_of_the_standard() -> None:
    made = list(itertools.islice(traceparents(0.5), 5000))
    contexts = [parse(value) for value in made]
    assert all(re.fullmatch(rb'00-[0-9a-f]{32}-[0-9a-f]{16}-0[01]', value) for value in made)
    assert len({context.trace_id for context in contexts if context}) == len(made)
    assert len({context.span_id for context in contexts if context}) == len(made)


@pytest.mark.parametrize(('sample', 'least', 'most'), [(0, 0, 0), (1, 5000, 5000)])
def test_none_or_all_are_sampled_where_the_share_says_so(
    sample: float, least: int, most: int
) -> None:
    made = list(itertools.islice(traceparents(sample), 5000))
    assert least <= sum(value.endswith(b'-01') for value in made) <= most


@pytest.mark.parametrize('sample', [0.01, 0.3])
def test_the_share_that_is_sampled_is_the_one_asked_for(sample: float) -> None:
    count = 40_000
    sampled = sum(
        value.endswith(b'-01') for value in itertools.islice(traceparents(sample), count)
    )
    # Six standard deviations: it fails by chance once in half a billion runs.
    margin = 6 * (count * sample * (1 - sample)) ** 0.5
    assert abs(sampled - count * sample) < margin


def test_the_share_is_taken_as_opentelemetry_takes_it() -> None:
    from opentelemetry.sdk.trace.sampling import Decision, TraceIdRatioBased  # noqa: PLC0415

    sampler = TraceIdRatioBased(0.25)
    for value in itertools.islice(traceparents(0.25), 2000):
        context = parse(value)
        assert context is not None
        theirs = sampler.should_sample(None, int(context.trace_id, 16), 'x').decision
        assert (theirs is Decision.RECORD_AND_SAMPLE) is context.sampled


def test_no_id_is_nothing_but_zeros() -> None:
    blocks = iter([bytes(256 * 24), bytes(range(1, 25)) * 255 + b'\1' * 16 + bytes(8)])
    made = traceparents(1, lambda size: next(blocks, b'\x11' * size))
    assert next(made) == b'00-' + b'11' * 16 + b'-' + b'11' * 8 + b'-01'
