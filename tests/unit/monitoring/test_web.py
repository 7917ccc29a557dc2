"""What may be asked for, and what comes back."""

import asyncio
import json
import threading
from typing import Any, Final

import pytest
from prometheus_client.exposition import generate_latest
from prometheus_client.registry import Collector
from support.monitoring.monitors import TOKEN, report, snapshot

from ros2_kafka_bridge.errors import TransportError
from ros2_kafka_bridge.monitoring import letters, view, web
from ros2_kafka_bridge.protocol.monitor import Answer
from ros2_kafka_bridge.route.counters import Measures, Trouble

from .conftest import CONFIG, Told, configured
from .sites import ORDERING, Site

SAID: Final = 'a bug of the bridge: its log says more'


@pytest.fixture
def site(told: Told) -> Site:
    return Site(told)


def test_a_route_is_paused_and_resumed_by_its_name(site: Site) -> None:
    assert site.post('api/routes/orders/pause').json()['text'] == 'pause orders'
    assert site.post('api/routes/orders/resume').json()['done'] is True
    assert site.post('api/routes/nobody/pause').status_code == 404
    assert [(it.do, it.route) for it in site.told.requests] == [
        ('pause', 'orders'), ('resume', 'orders'),
    ]  # fmt: skip


def test_what_the_bridge_refuses_is_told_with_its_reason(site: Site) -> None:
    site.told.answer = lambda it: Answer(it.number, done=False, text='x.yaml:3: wrong')
    answer = site.post('api/reload', {'preview': False})
    assert answer.status_code == 409
    assert answer.json()['error'] == 'x.yaml:3: wrong'


def test_a_reload_tells_what_changes(site: Site) -> None:
    changes = ('route a: added', 'route b: removed')
    site.told.answer = lambda it: Answer(it.number, done=True, text='2 changes', changes=changes)
    answer = site.post('api/reload', {'preview': True})
    assert answer.json()['changes'] == list(changes)
    site.post('api/reload', {'preview': False})
    assert [it.do for it in site.told.requests] == ['preview', 'reload']


@pytest.mark.parametrize(
    'content', [b'{', b'[]', b'{"preview": 1}', b'{}', b'{"preview": true, "x": 1}', b'\xff']
)
def test_what_is_no_order_is_refused(site: Site, content: bytes) -> None:
    assert site.post('api/reload', content).status_code == 400
    assert site.post('api/reload', b' ' * 300_000).status_code == 413
    assert site.told.requests == []


def test_a_replay_is_of_a_topic_of_this_bridge_and_of_its_letters(site: Site) -> None:
    order = {'topic': 'orders.dead-letters', 'dry_run': True}
    assert site.post('api/replay', order).status_code == 202
    places = ['orders.dead-letters[0]@5']
    assert site.post('api/replay', {**order, 'places': places}).status_code == 202
    for wrong in (
        {'topic': 'secrets', 'dry_run': True},
        {**order, 'places': []},
        {**order, 'places': ['secrets[0]@5']},
        {**order, 'places': ['orders.dead-letters[0]']},
        {**order, 'to_ros': True, 'force': True},
        {'topic': 'orders.dead-letters'},
    ):
        assert site.post('api/replay', wrong).status_code == 400, wrong
    first, second = site.replay.orders
    assert (first.form.places, first.form.dry_run) == (None, True)
    assert first.values == configured(CONFIG).values
    assert second.form.places == tuple(places)
    site.replay.runs = True
    assert site.post('api/replay', order).status_code == 409
    assert site.post('api/replay/stop').status_code == 200


def test_only_dead_letter_topics_of_this_bridge_can_be_read(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(letters, 'newest', lambda _, topic: {'topic': topic})
    assert site.get('api/dead-letters/orders.dead-letters').status_code == 200
    assert site.get('api/dead-letters/secrets').status_code == 404
    token = {'authorization': f'Bearer {TOKEN}'}
    assert site.get('api/dead-letters/secrets/0/5', **token).status_code == 404


def test_a_look_whether_the_stream_is_there_ends(site: Site) -> None:
    answer = site.ask('HEAD', 'api/events')
    assert (answer.status_code, answer.content) == (200, b'')
    assert answer.headers['content-type'].startswith('text/event-stream')


def test_a_letter_farther_than_kafka_counts_is_none(site: Site) -> None:
    token = {'authorization': f'Bearer {TOKEN}'}
    topic = 'orders.dead-letters'
    for place in (f'0/{2**63}', f'{2**31}/0', f'0/{10**30}', f'{"9" * 4400}/0', '-1/0', 'x/0'):
        assert site.get(f'api/dead-letters/{topic}/{place}', **token).status_code == 404
    order = {'topic': 'orders.dead-letters', 'dry_run': True}
    places = [f'orders.dead-letters[0]@{2**63}']
    assert site.post('api/replay', {**order, 'places': places}).status_code == 400


def test_a_broker_that_is_away_is_a_sentence(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any) -> None:
        raise TransportError('no broker answers')

    monkeypatch.setattr(letters, 'newest', fail)
    answer = site.get('api/dead-letters/orders.dead-letters')
    assert (answer.status_code, answer.json()['error']) == (503, 'no broker answers')


def test_letters_are_read_once_for_all_who_ask_until_a_replay(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[str] = []

    def newest(_: Any, topic: str) -> dict[str, Any]:
        read.append(topic)
        if len(read) > 1:
            raise TransportError('no broker answers')
        return {'topic': topic}

    monkeypatch.setattr(letters, 'newest', newest)
    path = 'api/dead-letters/orders.dead-letters'

    async def run() -> None:
        async with site.browser() as client:
            for expected, readings in ((200, 1), (503, 2)):  # one that is away, too, is asked once
                answers = await asyncio.gather(*map(client.get, [path] * 12))
                assert {it.status_code for it in answers} == {expected}
                assert len(read) == readings
                order = {'topic': 'orders.dead-letters', 'dry_run': False}
                await client.post('api/replay', headers=ORDERING, json=order)

    asyncio.run(run())


def test_who_shows_the_token_waits_behind_no_reading_of_others(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    others = threading.Event()
    monkeypatch.setattr(letters, 'newest', lambda _, topic: {'free': others.wait(30), 'of': topic})
    path = 'api/dead-letters/orders.dead-letters'

    async def run() -> None:
        async with site.browser() as client:
            waiting = [asyncio.create_task(client.get(path)) for _ in range(3)]
            await asyncio.sleep(0.1)
            monkeypatch.setattr(letters, 'newest', lambda *_: {'letters': []})
            shown = {'authorization': f'Bearer {TOKEN}'}
            async with asyncio.timeout(20):
                assert (await client.get(path, headers=shown)).json() == {'letters': []}
            assert not any(it.done() for it in waiting)
            others.set()
            await asyncio.gather(*waiting)

    asyncio.run(run())


def test_a_letter_that_is_gone_is_not_found(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(letters, 'look', lambda *_: None)
    answer = site.get('api/dead-letters/orders.dead-letters/0/5', authorization=f'Bearer {TOKEN}')
    assert answer.status_code == 404


def test_the_state_tells_each_route_and_its_errors(site: Site) -> None:
    trouble = Trouble(1000.0, 'DecodeError', 'orders[0]@3: not UTF-8', 4)
    orders = snapshot('orders', measures=Measures(troubles=(trouble,)))
    site.told.tell(report(orders, snapshot('returned')))
    state = site.get('api/state').json()
    assert [route['name'] for route in state['routes']] == ['orders', 'returned']
    assert state['bridge']['ready'] is True
    assert [route['group'] for route in state['about']] == ['test.orders', None]
    [told] = state['troubles']
    assert (told['route'], told['times']) == ('orders', 4)
    assert told['advice']
    assert TOKEN not in json.dumps(state)
    assert site.get('api/history').json()['routes'].keys() == {'orders', 'returned'}
    assert site.get('api/graph').json()['seen_s'] is None


def test_health_is_told_as_text_and_as_json(site: Site) -> None:
    assert site.get('readyz').text == 'ok'
    assert '[+]route/returned ok: waiting: Kafka is away' in site.get('readyz?verbose').text
    assert site.get('livez', accept='application/json').json()['ok'] is True
    site.told.tell(report(snapshot('orders')))
    assert site.get('readyz').status_code == 503


def test_what_is_not_there_is_said_in_words(site: Site) -> None:
    assert site.get('nothing').json()['error'] == 'there is nothing here'
    assert site.get('static/../web.py').status_code == 404
    assert site.get('static/%2e%2e/web.py').status_code == 404
    assert site.ask('DELETE', 'api/state', ORDERING).status_code == 405


@pytest.mark.parametrize('method', ['POST', 'PUT', 'DELETE', 'OPTIONS'])
@pytest.mark.parametrize('path', ['', 'metrics', 'livez', 'api/state', 'static/main.js'])
def test_what_can_only_be_read_says_so(site: Site, path: str, method: str) -> None:
    for headers in ({}, {'content-type': 'text/plain'}, ORDERING):
        answer = site.ask(method, path, headers)
        assert (answer.status_code, answer.json()['error']) == (405, 'not in this way')
        assert answer.headers['allow'] == 'GET, HEAD'


def test_what_can_only_be_ordered_says_so(site: Site) -> None:
    for method in ('GET', 'OPTIONS'):
        answer = site.ask(method, 'api/reload')
        assert (answer.status_code, answer.headers['allow']) == (405, 'POST')


def test_metrics_can_be_chosen_by_name(site: Site) -> None:
    text = site.get('metrics?name[]=ros2_kafka_bridge_worker_up').text
    assert 'ros2_kafka_bridge_worker_up' in text
    assert 'messages_taken' not in text


def test_metrics_are_made_once_for_each_report(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[Collector] = []

    def encode(registry: Collector) -> bytes:
        made.append(registry)
        return generate_latest(registry)

    monkeypatch.setattr(web, 'generate_latest', encode)
    monkeypatch.setattr(web, '_KEPT_S', 60.0)
    site = Site(site.told)
    odd = [f'text/plain; version=1.{n}; escaping=dots' for n in range(9)]
    for accept in ['', 'a/b', *odd]:
        for coding in ('gzip', 'identity'):
            answer = site.get('metrics', accept=accept, **{'accept-encoding': coding})
            assert 'route="orders"' in answer.text
            assert 'dots' not in answer.headers['content-type']
    assert len(made) == 1
    site.told.tell(report(snapshot('returned')))
    assert 'taken_total{bridge="test",route="orders"}' not in site.get('metrics').text


def test_who_asks_for_a_replay_sees_it_in_the_state_at_once(
    told: Told, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(web, '_KEPT_S', 60.0)
    site = Site(told)
    assert site.get('api/state').json()['replay'] is None
    site.post('api/replay', {'topic': 'orders.dead-letters', 'dry_run': True})
    assert site.get('api/state').json()['replay'] == {'number': 1}


def test_not_any_number_of_names_is_looked_for(site: Site) -> None:
    many = '&'.join(f'name[]=x{number}' for number in range(101))
    answer = site.get(f'metrics?{many}')
    assert (answer.status_code, 'more than 100 names' in answer.text) == (400, True)


@pytest.mark.parametrize(
    'accept',
    [
        'application/openmetrics-text; version=zzz',
        'application/openmetrics-text;version=1.0.0=2',
        'application/openmetrics-text; version=',
        'text/plain; version=1.0.0; escaping=zzz',
        'a/b' * 2000,
        ';;=,=;"',
    ],
)
def test_metrics_are_answered_however_oddly_they_are_asked_for(
    site: Site, caplog: pytest.LogCaptureFixture, accept: str
) -> None:
    answer = site.get('metrics', accept=accept)
    assert answer.status_code == 200
    assert 'ros2_kafka_bridge_' in answer.text
    assert not caplog.records


@pytest.mark.parametrize(
    'bug',
    [
        SystemExit(1), AssertionError(), TypeError('a\nb'), RuntimeError(), MemoryError(),
        RecursionError(), OSError(5, 'no'), ImportError('x'), SyntaxError('x'),
    ],
)  # fmt: skip
def test_a_bug_behind_a_request_is_one_line_however_often(
    site: Site,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    bug: BaseException,
) -> None:
    def fail(*_: Any) -> None:
        raise bug

    monkeypatch.setattr(view, 'sections', fail)
    monkeypatch.setattr(web, '_encoder', fail)
    for path in ['api/state', 'metrics'] * 20:
        answer = site.get(path)
        assert (answer.status_code, answer.json()) == (500, {'error': SAID})
    assert site.get('livez').status_code in {200, 503}
    [line] = caplog.records
    what = 'x' if isinstance(bug, ImportError) else type(bug).__name__
    assert line.getMessage().startswith(f'the page could not answer GET /api/state: {what}')
    assert 'by way of ' in line.getMessage()
    assert 'web.py:' in line.getMessage()
    assert '\n' not in line.getMessage()
    assert line.exc_info is None


def test_who_leaves_in_the_middle_of_a_request_is_no_bug(
    site: Site, caplog: pytest.LogCaptureFixture
) -> None:
    sent = asyncio.run(site.leave('api/reload'))
    assert sent == []
    assert not caplog.records


def test_all_files_of_the_page_are_its_own(site: Site) -> None:
    page = site.get('').text
    assert 'http' not in page
    assert 'style=' not in page
    assert '<script>' not in page
    shared = ('shared/base.css', 'shared/dom.js', 'shared/server.js')
    for name in ('main.js', 'style.css', 'icon.svg', *shared):
        assert site.get(f'static/{name}').status_code == 200
