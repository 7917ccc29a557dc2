"""Only the page's own pages may order, and only under the names that it was told."""

import asyncio

import httpx
import pytest

from ros2_kafka_bridge.web.guard import names_of
from ros2_kafka_warehouse.domain.site import Site
from ros2_kafka_warehouse.page.app import Page, make_app

PAGE = 'http://127.0.0.1:8080'
JSON = {'content-type': 'application/json'}
OURS = {'origin': PAGE, **JSON}
READ = 400  # an order was looked into: this one has no lines
SITE = Site('small', ('....',), {'packing-1': (3, 0)}, {}, {})


def ask(
    method: str, headers: dict[str, str], host: str = '127.0.0.1', *more: str, path: str = ''
) -> httpx.Response:
    names = names_of(host, 8080, more)
    app = make_app(Page(SITE, {}, '', names, lambda: True, lambda: None))
    path = path or ('/' if method == 'GET' else '/api/orders')

    async def once() -> httpx.Response:
        transport = httpx.ASGITransport(app)
        async with httpx.AsyncClient(transport=transport, base_url=PAGE) as client:
            return await client.request(method, path, headers=headers, content='{}')

    return asyncio.run(once())


def test_the_page_itself_may_read_and_order() -> None:
    assert ask('GET', {}).status_code == 200
    assert ask('POST', OURS).status_code == READ


@pytest.mark.parametrize('host', ['127.0.0.1:8080', 'localhost:8080', '[::1]:8080', 'LOCALHOST'])
def test_this_machine_has_several_names(host: str) -> None:
    assert ask('GET', {'host': host}).status_code == 200


@pytest.mark.parametrize('host', ['evil.example', 'evil.example:8080', '127.0.0.1:9999', ''])
def test_a_name_that_was_bent_to_this_address_gets_nothing(host: str) -> None:
    answer = ask('GET', {'host': host})
    assert answer.status_code == 421
    assert 'id="map"' not in answer.text


@pytest.mark.parametrize('method', ['POST', 'PUT', 'DELETE'])
@pytest.mark.parametrize(
    'origin',
    ['http://evil.example', 'null', '', 'http://localhost:8080', 'http://127.0.0.1:8081'],
)
def test_a_page_of_another_site_may_order_nothing(method: str, origin: str) -> None:
    answer = ask(method, {**OURS, 'origin': origin})
    assert answer.status_code == 403
    assert 'may change nothing here' in answer.json()['error']


def test_a_request_without_origin_may_order_nothing() -> None:
    answer = ask('POST', JSON)
    assert answer.status_code == 403
    assert answer.json() == {'error': 'a request without Origin may change nothing here'}


@pytest.mark.parametrize('where', ['cross-site', 'same-site'])
def test_what_another_site_makes_a_browser_ask_for_is_refused(where: str) -> None:
    theirs = {'sec-fetch-site': where}
    assert ask('GET', theirs, path='/api/site').status_code == 403
    assert ask('POST', {**OURS, **theirs}).status_code == 403
    assert ask('GET', theirs).status_code == 200  # a link to the page


@pytest.mark.parametrize('kind', ['text/plain', 'application/x-www-form-urlencoded', ''])
def test_what_a_plain_form_can_send_is_refused(kind: str) -> None:
    answer = ask('POST', {**OURS, 'content-type': kind})
    assert answer.status_code == 415


def test_a_name_that_the_user_adds_is_served() -> None:
    headers = {'host': 'floor.example:8080', 'origin': 'https://floor.example:8080', **JSON}
    assert ask('POST', headers).status_code == 421
    assert ask('POST', headers, '0.0.0.0', 'floor.example').status_code == READ  # noqa: S104


def test_every_answer_keeps_the_page_to_itself() -> None:
    for answer in (ask('GET', {}), ask('GET', {'host': 'evil.example'})):
        policy = answer.headers['content-security-policy']
        assert "default-src 'none'" in policy
        assert 'unsafe' not in policy
        assert "frame-ancestors 'none'" in policy
        assert answer.headers['x-content-type-options'] == 'nosniff'
        assert answer.headers['x-frame-options'] == 'DENY'
        assert 'access-control-allow-origin' not in answer.headers


@pytest.mark.parametrize('name', ['main.js', 'shared/dom.js', 'shared/server.js'])
def test_files_are_asked_for_anew_and_sent_only_where_they_have_changed(name: str) -> None:
    answer = ask('GET', {}, path=f'/static/{name}')
    assert (answer.status_code, answer.headers['cache-control']) == (200, 'no-cache')
    known = {'if-none-match': answer.headers['etag']}
    assert ask('GET', known, path=f'/static/{name}').status_code == 304
