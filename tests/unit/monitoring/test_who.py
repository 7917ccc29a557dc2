"""Who may look, read what messages hold, and change something."""

import asyncio
import logging
import os
from typing import Any, Final

import pytest
from starlette.routing import Route
from support.monitoring.monitors import TOKEN

from ros2_kafka_bridge.monitoring import letters, rights
from ros2_kafka_bridge.web.guard import is_loopback

from .conftest import CONFIG, Told
from .sites import HOST, ORDERING, Site

WRITES: Final = [
    ('api/token', {}),
    ('api/routes/orders/pause', {}),
    ('api/routes/orders/resume', {}),
    ('api/reload', {'preview': True}),
    ('api/replay', {'topic': 'orders.dead-letters', 'dry_run': True}),
    ('api/replay/stop', {}),
]


@pytest.fixture
def site(told: Told) -> Site:
    return Site(told)


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
def test_nothing_is_done_without_the_token(
    site: Site, monkeypatch: pytest.MonkeyPatch, path: str, content: Any
) -> None:
    monkeypatch.setattr(rights, '_WRONG_TOKEN_S', 0.0)
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


@pytest.mark.parametrize('method', ['POST', 'PUT', 'DELETE', 'OPTIONS'])
@pytest.mark.parametrize('path', ['', 'metrics', 'api/state', 'api/reload', 'nothing'])
def test_another_site_does_not_learn_which_ways_there_are(
    site: Site, path: str, method: str
) -> None:
    answer = site.ask(method, path, {'origin': 'http://evil.example'})
    assert answer.status_code == 403
    assert 'allow' not in answer.headers
    assert site.ask(method, path, {'sec-fetch-site': 'cross-site'}).status_code == 403
    assert site.ask(method, path, {'host': 'evil.example'}).status_code == 421


def test_all_that_can_be_ordered_is_tried_here(site: Site) -> None:
    routes = [it for it in site.app.routes if isinstance(it, Route)]
    ordered = [it.path for it in routes if it.methods != {'GET', 'HEAD'}]
    tried = [f'/{path}'.replace('/orders/', '/{name}/') for path, _ in WRITES]
    assert sorted(ordered) == sorted(tried)


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


@pytest.mark.parametrize('where', ['cross-site', 'same-site'])
@pytest.mark.parametrize('path', ['metrics', 'livez', 'readyz'])
def test_what_programs_ask_for_is_nothing_for_a_page_of_another_site(
    site: Site, path: str, where: str
) -> None:
    for mode, kind in (('no-cors', 'image'), ('cors', 'empty'), ('navigate', 'iframe')):
        headers = {'sec-fetch-site': where, 'sec-fetch-mode': mode, 'sec-fetch-dest': kind}
        assert site.ask('GET', path, headers).status_code == 403
        assert site.ask('HEAD', path, headers).status_code == 403
    assert site.ask('GET', path, {'sec-fetch-site': where}).status_code == 403
    # Prometheus shows a link to each of its targets.
    link = {'sec-fetch-site': where, 'sec-fetch-mode': 'navigate', 'sec-fetch-dest': 'document'}
    assert site.ask('GET', path, link).status_code != 403
    assert site.ask('GET', path, {'host': 'prometheus.example'}).status_code != 403


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


def test_what_a_message_holds_is_for_those_with_the_token(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(letters, 'look', lambda _, place: {'place': str(place)})
    path = 'api/dead-letters/orders.dead-letters/0/5'
    assert site.get(path).status_code == 401
    answer = site.get(path, authorization=f'Bearer {TOKEN}')
    assert answer.json() == {'place': 'orders.dead-letters[0]@5'}


def test_without_a_token_messages_are_shown_to_the_own_user_only(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(letters, 'look', lambda _, place: {'place': str(place)})
    users: dict[str, int | None] = {'127.0.0.1': os.getuid()}
    monkeypatch.setattr(rights, 'user_of', lambda caller, _: users.get(caller.host))
    site = Site(Told(CONFIG.replace(f'token: {TOKEN}, ', '')))
    path = 'api/dead-letters/orders.dead-letters/0/5'
    assert site.get(path).status_code == 200
    assert site.get(path, host='ops.example').status_code == 403
    # What a proxy passes on for somebody else.
    assert site.get(path, **{'x-forwarded-for': '10.1.2.3'}).status_code == 403
    # From elsewhere anybody can write this machine's name into Host.
    site.client = '10.1.2.3'
    assert site.get(path, host='localhost:9464').status_code == 403
    # A proxy on this machine that says nothing of whom it asks for.
    site.client, users['127.0.0.1'] = '127.0.0.1', os.getuid() + 1
    assert site.get(path).status_code == 403


def test_how_often_a_wrong_token_came_is_said_when_the_page_ends(
    told: Told, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(rights, '_WRONG_TOKEN_S', 0.0)
    logger = logging.getLogger('ros2_kafka_bridge')
    monkeypatch.setattr(logger, 'handlers', [caplog.handler])
    monkeypatch.setattr(logger, 'propagate', False)
    site = Site(told)

    async def run() -> None:
        async with site.app.router.lifespan_context(site.app):
            await asyncio.gather(*[guess() for _ in range(8)])

    async def guess() -> None:
        answer = await site.browser().post(
            '/api/token', headers={**ORDERING, 'authorization': 'Bearer no'}, content=b'{}'
        )
        assert answer.status_code == 401

    asyncio.run(run())
    assert caplog.messages == [
        'the page: a wrong token from 127.0.0.1',
        'the page: a wrong token (7 times more) from 127.0.0.1',
    ]
