"""What may be asked for, by whom, and what comes back."""

import asyncio
import json
from typing import Any, Final

import httpx
import pytest
from monitors import TOKEN, report, snapshot

from ros2_kafka_bridge.errors import TransportError
from ros2_kafka_bridge.monitoring import letters
from ros2_kafka_bridge.monitoring.guard import is_loopback, names_of
from ros2_kafka_bridge.monitoring.replay_process import ReplayOrder
from ros2_kafka_bridge.monitoring.web import Page, make_app
from ros2_kafka_bridge.protocol.monitor import Answer
from ros2_kafka_bridge.route.counters import Measures, Trouble

from .conftest import CONFIG, Told, configured

HOST: Final = '127.0.0.1:9464'
PAGE: Final = f'http://{HOST}'
ORDERING: Final = {
    'authorization': f'Bearer {TOKEN}',
    'content-type': 'application/json',
    'origin': PAGE,
}
WRITES: Final = [
    ('api/token', {}),
    ('api/routes/orders/pause', {}),
    ('api/routes/orders/resume', {}),
    ('api/reload', {'preview': True}),
    ('api/replay', {'topic': 'orders.dead-letters', 'dry_run': True}),
    ('api/replay/stop', {}),
]


class NoSides:
    """Kafka and ROS have not been seen yet."""

    def sections(self) -> dict[str, Any]:
        return {'broker': None, 'letters': []}

    def graph(self) -> dict[str, Any]:
        return {'problem': '', 'seen_s': None, 'topics': []}


class NoReplay:
    """Keeps what it was told to do."""

    def __init__(self) -> None:
        self.orders: list[ReplayOrder] = []
        self.runs = False

    def state(self) -> dict[str, Any] | None:
        return {'number': len(self.orders)} if self.orders else None

    def start(self, order: ReplayOrder) -> bool:
        self.orders.append(order)
        return not self.runs

    def stop(self) -> bool:
        return self.runs


class Site:
    """The application as it answers requests."""

    def __init__(self, told: Told, listen: str = '127.0.0.1') -> None:
        self.told = told
        self.client = '127.0.0.1'
        self.replay = NoReplay()
        sides: Any = NoSides()
        replay: Any = self.replay
        monitoring = told.watch.config.monitoring
        more = monitoring.allowed_hosts if monitoring else []
        names = names_of(listen, 9464, more)
        page = Page(told.watch, sides, replay, lambda: names, lambda: False, lambda: None)
        self.app = make_app(page)

    def ask(
        self, method: str, path: str, headers: dict[str, str] | None = None, content: Any = None
    ) -> httpx.Response:
        async def once() -> httpx.Response:
            transport = httpx.ASGITransport(self.app, client=(self.client, 1))
            async with httpx.AsyncClient(transport=transport, base_url=PAGE) as client:
                body = content if isinstance(content, bytes) else json.dumps(content).encode()
                sent = b'' if content is None else body
                return await client.request(method, f'/{path}', headers=headers, content=sent)

        return asyncio.run(once())

    def get(self, path: str, **headers: str) -> httpx.Response:
        return self.ask('GET', path, headers)

    def post(self, path: str, content: Any = None, **headers: str) -> httpx.Response:
        given = {name.replace('_', '-'): value for name, value in headers.items()}
        wanted = {**ORDERING, **given}
        return self.ask('POST', path, {n: v for n, v in wanted.items() if v}, content or {})


@pytest.fixture
def site(told: Told) -> Site:
    return Site(told)


# Who


@pytest.mark.parametrize('host', ['evil.example', 'evil.example:9464', '127.0.0.1:1', ''])
@pytest.mark.parametrize('path', ['', 'api/state', 'api/graph', 'static/main.js'])
def test_a_name_that_was_bent_to_this_address_sees_no_page(
    site: Site, host: str, path: str
) -> None:
    answer = site.get(path, host=host)
    assert answer.status_code == 421
    assert 'monitoring.allowed_hosts' in answer.json()['error']


@pytest.mark.parametrize(
    'host', [HOST, 'localhost:9464', '[::1]:9464', 'OPS.example', 'ops.example:9464']
)
def test_the_own_names_and_those_of_the_file_see_it(site: Site, host: str) -> None:
    assert site.get('api/state', host=host).status_code == 200


@pytest.mark.parametrize('path', ['metrics', 'livez', 'readyz'])
def test_prometheus_and_the_kubelet_may_use_any_address(site: Site, path: str) -> None:
    assert site.get(path, host='10.1.2.3:9464').status_code == 200
    assert site.ask('POST', path, {'host': '10.1.2.3:9464'}).status_code == 421


@pytest.mark.parametrize(('path', 'content'), WRITES)
def test_nothing_is_done_without_the_token(site: Site, path: str, content: Any) -> None:
    for wrong in ('', 'Bearer', 'Bearer wrong', f'Basic {TOKEN}', f'Bearer {TOKEN}x'):
        answer = site.post(path, content, authorization=wrong)
        assert answer.status_code == 401, wrong
        assert answer.headers['www-authenticate'] == 'Bearer'
        assert TOKEN not in answer.text
    assert site.told.requests == []
    assert site.replay.orders == []


@pytest.mark.parametrize(('path', 'content'), WRITES)
def test_without_a_token_in_the_file_it_is_read_only(path: str, content: Any) -> None:
    site = Site(Told(CONFIG.replace(f'token: {TOKEN}, ', '')))
    answer = site.post(path, content)
    assert answer.status_code == 403
    assert 'monitoring.token' in answer.json()['error']
    assert site.get('api/state').json()['bridge']['may_change'] is False


@pytest.mark.parametrize(('path', 'content'), WRITES)
@pytest.mark.parametrize(
    ('headers', 'status'),
    [
        ({'origin': 'http://evil.example'}, 403),
        ({'origin': 'null'}, 403),
        ({'origin': 'http://localhost:9464'}, 403),
        ({'origin': 'http://127.0.0.1:8080'}, 403),
        ({'origin': '', 'sec_fetch_site': 'cross-site'}, 403),
        ({'origin': '', 'sec_fetch_site': 'same-site'}, 403),
        ({'host': 'evil.example'}, 421),
        ({'content_type': 'text/plain'}, 415),
        ({'content_type': 'application/x-www-form-urlencoded'}, 415),
        ({'content_type': ''}, 415),
    ],
)
def test_what_another_site_can_make_a_browser_send_is_refused(
    site: Site, path: str, content: Any, headers: dict[str, str], status: int
) -> None:
    assert site.post(path, content, **headers).status_code == status
    assert site.told.requests == []


@pytest.mark.parametrize('where', ['cross-site', 'same-site'])
@pytest.mark.parametrize('path', ['api/state', 'api/dead-letters/orders.dead-letters/0/0'])
def test_what_another_site_makes_a_browser_read_is_not_even_looked_up(
    site: Site, monkeypatch: pytest.MonkeyPatch, path: str, where: str
) -> None:
    looked: list[Any] = []
    monkeypatch.setattr(letters, 'look', lambda *asked: looked.append(asked))
    headers = {'authorization': f'Bearer {TOKEN}', 'sec-fetch-site': where}
    assert site.ask('GET', path, headers).status_code == 403
    assert looked == []
    assert site.ask('GET', '', headers).status_code == 200  # a link to the page


@pytest.mark.parametrize('where', ['same-origin', 'none'])
def test_the_page_itself_and_an_address_typed_in_are_answered(site: Site, where: str) -> None:
    assert site.ask('GET', 'api/state', {'sec-fetch-site': where}).status_code == 200


def test_the_page_behind_a_proxy_may_order(site: Site) -> None:
    path = 'api/routes/orders/pause'
    assert site.post(path, host='ops.example', origin='https://ops.example').status_code == 200
    assert site.post(path, origin='https://ops.example').status_code == 200


def test_a_program_that_is_no_browser_needs_the_token_alone(site: Site) -> None:
    assert site.post('api/routes/orders/pause', origin='').status_code == 200


def test_every_answer_keeps_the_page_to_itself(site: Site) -> None:
    for answer in (site.get(''), site.get('api/state'), site.get('x', host='evil.example')):
        policy = answer.headers['content-security-policy']
        assert "default-src 'none'" in policy
        assert "script-src 'self'" in policy
        assert 'unsafe' not in policy
        assert "frame-ancestors 'none'" in policy
        assert answer.headers['x-content-type-options'] == 'nosniff'
        assert answer.headers['cache-control'] == 'no-store'
        assert 'access-control-allow-origin' not in answer.headers
        assert 'set-cookie' not in answer.headers
        assert 'server' not in answer.headers


def test_which_names_are_this_machine() -> None:
    assert all(map(is_loopback, ('localhost', '127.0.0.1:1', '[::1]:9464', 'LOCALHOST:1')))
    assert not any(map(is_loopback, ('10.0.0.1', 'ops.example', '[fe80::1]:1', '')))


# What


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
    assert (first.places, first.dry_run) == (None, True)
    assert first.values == configured(CONFIG).values
    assert second.places == tuple(places)
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


def test_what_a_message_holds_is_for_those_with_the_token(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(letters, 'look', lambda _, place: {'place': str(place)})
    path = 'api/dead-letters/orders.dead-letters/0/5'
    assert site.get(path).status_code == 401
    answer = site.get(path, authorization=f'Bearer {TOKEN}')
    assert answer.json() == {'place': 'orders.dead-letters[0]@5'}


def test_without_a_token_messages_are_shown_to_this_machine_only(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(letters, 'look', lambda _, place: {'place': str(place)})
    site = Site(Told(CONFIG.replace(f'token: {TOKEN}, ', '')))
    path = 'api/dead-letters/orders.dead-letters/0/5'
    assert site.get(path).status_code == 200
    assert site.get(path, host='ops.example').status_code == 403
    # What a proxy passes on for somebody else.
    assert site.get(path, **{'x-forwarded-for': '10.1.2.3'}).status_code == 403
    site.client = '::ffff:127.0.0.1'
    assert site.get(path).status_code == 200
    # From elsewhere anybody can write this machine's name into Host.
    for client in ('10.1.2.3', '::ffff:10.1.2.3', 'fe80::1%eth0', ''):
        site.client = client
        assert site.get(path, host='localhost:9464').status_code == 403, client


def test_a_letter_farther_than_kafka_counts_is_none(site: Site) -> None:
    token = {'authorization': f'Bearer {TOKEN}'}
    topic = 'orders.dead-letters'
    for place in (f'0/{2**63}', f'{2**31}/0', f'0/{10**30}'):
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


def test_metrics_can_be_chosen_by_name(site: Site) -> None:
    text = site.get('metrics?name[]=ros2_kafka_bridge_worker_up').text
    assert 'ros2_kafka_bridge_worker_up' in text
    assert 'messages_taken' not in text


def test_all_files_of_the_page_are_its_own(site: Site) -> None:
    page = site.get('').text
    assert 'http' not in page
    assert 'style=' not in page
    assert '<script>' not in page
    for name in ('main.js', 'style.css', 'icon.svg'):
        assert site.get(f'static/{name}').status_code == 200
