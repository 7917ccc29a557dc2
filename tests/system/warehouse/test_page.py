"""The live page in a real browser, with a real Kafka."""

import shutil
import time
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Final

import httpx
import pytest
from confluent_kafka.admin import NewTopic  # type: ignore[attr-defined]  # public, not in __all__
from playwright.sync_api import Browser, expect, sync_playwright
from support.processes.harness import Bench, Process, eventually
from support.warehouse.page_stage import PATIENCE_MS, ROBOT, Stage

from ros2_kafka_bridge.testing.local_kafka import LocalKafka
from ros2_kafka_warehouse.codec import decode
from ros2_kafka_warehouse.messages.monitor import FailureEvent, FleetReport, OperatorCommand
from ros2_kafka_warehouse.messages.onlookers import ValidatorReport, Violation
from ros2_kafka_warehouse.messages.orders import (
    Line,
    OpenOrders,
    Order,
    OrderEvent,
    OrderLine,
    OrderRequest,
    OrderStatus,
)
from ros2_kafka_warehouse.topics import KAFKA

CHROMIUM: Final = shutil.which('chromium')

pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason='no chromium: apt install chromium'),
]


@pytest.fixture(scope='module')
def browser() -> Iterator[Browser]:
    expect.set_options(timeout=PATIENCE_MS)
    with sync_playwright() as playwright:
        found = playwright.chromium.launch(executable_path=CHROMIUM, args=['--no-sandbox'])
        yield found
        found.close()


@pytest.fixture(scope='module')
def stage(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    place = tmp_path_factory.mktemp('page')
    with LocalKafka() as kafka:
        bench = Bench(place, kafka.bootstrap_servers, 0)
        create_topics(bench)
        with serve(bench) as server:
            page = browser.new_page(viewport={'width': 1440, 'height': 900})
            page.set_default_timeout(PATIENCE_MS)
            stage = Stage(kafka, bench, server, page)
            stage.drive()
            page.goto(stage.url)
            yield stage
            page.close()
            assert server.end() == 0, server.output()


def create_topics(bench: Bench) -> None:
    new = [NewTopic(topic.name, num_partitions=1, replication_factor=1) for topic in KAFKA]
    admin = bench.admin()  # kept: its futures fail when it goes
    for made in admin.create_topics(new).values():
        made.result(20)


def serve(bench: Bench, *more: str) -> Process:
    options = ['--bootstrap-servers', bench.bootstrap_servers, '--port', '0', *more]
    server = bench._start('-m', 'ros2_kafka_warehouse.page', *options)
    server.wait_for('shown at')
    return server


@pytest.fixture(autouse=True)
def _nothing_goes_wrong_in_the_browser(stage: Stage) -> Iterator[None]:
    yield
    assert stage.said == []


def test_robots_are_seen_to_move_smoothly(stage: Stage) -> None:
    eventually(stage.is_live, 60)
    expect(stage.page.locator('#robots')).to_contain_text(ROBOT)
    between: list[float] = []

    def glides() -> bool:
        stage.drive()
        row = float(stage.look(f"window.warehouse.map.robots.get('{ROBOT}')?.y ?? 0"))
        if row % 1 != 0:
            between.append(row)
        return len(set(between)) >= 3

    eventually(glides, 60)
    assert stage.look("document.getElementById('map').width") > 300


def test_an_order_of_the_form_arrives_in_kafka(stage: Stage) -> None:
    page = stage.page
    page.click('#new-order')
    page.select_option('#order-station', 'packing-2')
    page.select_option('#order-priority', '6')
    page.fill('#order-due', '5')
    page.select_option('#order-lines .product', 'green-tea')
    page.fill('#order-lines .quantity', '3')
    page.click('#order-send')
    expect(page.locator('#toast')).to_contain_text('was sent')
    [value] = stage.values('warehouse.orders', 1)
    order = decode(value, OrderRequest)
    assert order.order_id in (page.locator('#toast').text_content() or '')
    assert (order.station, order.priority) == ('packing-2', 6)
    assert order.lines == (Line('L1', 'green-tea', 3),)
    assert order.due_time is not None
    assert 0 < order.due_time.timestamp() - time.time() <= 300


def test_a_robot_is_failed_and_a_cell_is_blocked(stage: Stage) -> None:
    page = stage.page
    page.locator('#robots .row-name', has_text=ROBOT).click()
    page.select_option('#fail-code', 'COMM_LOST')
    page.click('#fail')
    expect(page.locator('#toast')).to_contain_text(f'{ROBOT}')
    page.check('#block-mode')
    cell = stage.look(
        '(() => { const m = window.warehouse.map, at = (n) => (n + 0.5 + 0.6) * m.cell;'
        ' return { x: at(2), y: at(3) }; })()'
    )
    page.click('#map', position=cell)
    expect(page.locator('#toast')).to_contain_text('cell 2, 3')
    page.uncheck('#block-mode')
    failed, blocked = (
        decode(value, OperatorCommand) for value in stage.values('warehouse.commands', 2)
    )
    assert (failed.command, failed.robot, failed.failure) == ('failRobot', ROBOT, 'COMM_LOST')
    assert (blocked.command, blocked.cell, blocked.known) == ('blockCell', (2, 3), False)
    assert failed.command_id != blocked.command_id
    eventually(lambda: stage.look('window.warehouse.map.placed.length') == 1, 60)


def test_a_failure_is_told_with_its_cause_and_answer(stage: Stage) -> None:
    def tell(event: str, **more: str) -> None:
        stage.put('warehouse.failures', FailureEvent('f1', event, time.time(), **more))  # type: ignore[arg-type]

    tell('FailureDetected', robot=ROBOT, evidence='no state for 5.2 s')
    tell('FailureDiagnosed', robot=ROBOT, code='COMM_LOST', cause='communications')
    tell('ResponseOrdered', robot=ROBOT, response='reassign')
    card = stage.page.locator('#failures .card')
    for words in ('Comm lost', ROBOT, 'no state for 5.2 s', 'Cause: communications', 'reassign'):
        expect(card).to_contain_text(words)
    tell('FailureResolved', robot=ROBOT, outcome='repaired')
    expect(card).to_contain_text('repaired')
    expect(stage.page.locator('#failures-count')).to_have_text('0 open, 1 in all')


def test_a_failure_that_is_open_stands_above_those_that_are_over(stage: Stage) -> None:
    for name in ('f2', 'f3'):
        stage.put('warehouse.failures', FailureEvent(name, 'FailureDetected', 1.0, robot=name))
    stage.put('warehouse.failures', FailureEvent('f3', 'FailureResolved', 2.0))
    names = stage.page.locator('#failures .card .link')
    expect(names).to_have_text(['f2', 'f3', ROBOT])


def test_text_of_kafka_is_never_html(stage: Stage) -> None:
    evil = '<img src=x onerror="document.title=1"><script>document.title=2</script>'
    lines = (OrderLine('L1', evil),)
    order = Order(evil, 0, evil, lines, time.time(), status=OrderStatus.PLANNED)
    stage.put('warehouse.open-orders', OpenOrders((order,)))
    row = stage.page.locator('#orders .row-name').first
    expect(row).to_have_text(evil)
    row.click()
    expect(stage.page.locator('#orders .lines .what')).to_contain_text(evil)
    assert stage.page.locator('main img').count() == 0
    assert 'Grocery' in stage.page.title()


def test_a_broken_rule_is_a_red_banner_until_a_person_has_seen_it(stage: Stage) -> None:
    broken = Violation(7, 'vertex', 'two robots on cell 3,3')
    stage.put('warehouse.validator', ValidatorReport(7, 7, (broken,)))
    banner = stage.page.locator('.banner.bad')
    expect(banner).to_contain_text('two robots on cell 3,3')
    stage.page.click('#acknowledge')
    expect(banner).to_have_count(0)
    stage.put('warehouse.validator', ValidatorReport(8, 1))  # it was started again
    eventually(lambda: stage.look('window.warehouse.view.validator.broken') == 0, 60)
    stage.put('warehouse.validator', ValidatorReport(9, 2, (Violation(9, 'edge', 'a swap'),)))
    expect(banner).to_contain_text('a swap')


def test_a_stop_is_one_banner_and_the_focus_stays_with_its_buttons(stage: Stage) -> None:
    page, banner = stage.page, stage.page.locator('.banner.bad')
    stage.put('warehouse.fleet', FleetReport(stage.step, halted='rule broken in step 9: a swap'))
    expect(banner).to_have_count(1)
    expect(banner).to_contain_text('All robots stand')
    expect(banner.locator('button')).to_have_text(['Acknowledge', 'Acknowledge and resume'])
    assert page.locator('#resume').count() == 1
    before = stage.bench.end_offset('warehouse.commands')
    page.click('#acknowledge-resume')
    eventually(lambda: stage.bench.end_offset('warehouse.commands') == before + 2, 60)
    expect(banner).to_contain_text('All robots stand: rule broken')
    expect(page.locator('#resume')).to_be_focused()
    stage.put('warehouse.fleet', FleetReport(stage.step))
    expect(banner).to_have_count(0)
    expect(page.locator('#pause')).to_be_focused()


def test_a_rate_may_be_a_fraction_but_not_empty(stage: Stage) -> None:
    page = stage.page
    page.fill('#per-minute', '0.5')
    page.press('#per-minute', 'Enter')
    expect(page.locator('#toast')).to_have_text('Random orders: 0.5 a minute.')
    page.fill('#per-minute', '')
    page.press('#per-minute', 'Enter')
    assert page.evaluate("document.querySelector('#per-minute:invalid') !== null")
    page.fill('#per-minute', '0')
    page.press('#per-minute', 'Enter')
    expect(page.locator('#toast')).to_have_text('No more random orders.')


def test_orders_that_nobody_answers_are_warned_of_until_they_are(stage: Stage) -> None:
    request = OrderRequest('asked', station='packing-1')
    stage.put('warehouse.orders', request)
    warning = stage.page.locator('.banner.warn', has_text='the intake of orders stands still')
    expect(warning).to_contain_text('had no answer since')
    answer_all(stage)
    expect(warning).to_have_count(0)


def answer_all(stage: Stage) -> None:
    """As the desk does."""
    for value in stage.values('warehouse.orders', stage.bench.end_offset('warehouse.orders')):
        order = decode(value, OrderRequest)
        event = OrderEvent(order.order_id, 0, OrderStatus.REJECTED, time.time(), reason='no desk')
        stage.put('warehouse.order-events', event)


def test_an_order_due_in_the_year_one_does_not_end_the_page(stage: Stage) -> None:
    due = datetime(1, 1, 1)  # noqa: DTZ001 (that is the point: it has no zone)
    stage.put('warehouse.orders', OrderRequest('year-one', due_time=due))
    answer_all(stage)
    stage.page.click('#orders-ended')
    expect(stage.page.locator('#orders .row-name', has_text='year-one')).to_be_visible()
    stage.page.click('#orders-open')


def test_an_order_is_not_called_on_time_before_anybody_can_say(stage: Stage) -> None:
    now_s = time.time()
    lines = (OrderLine('L1', 'tea'),)
    unknown = Order('unknown', 0, 'packing-1', lines, now_s, due_s=now_s + 600)
    known = Order('known', 0, 'packing-1', lines, now_s, due_s=now_s + 601, eta_s=now_s + 300)
    late = Order('late', 0, 'packing-1', lines, now_s, due_s=now_s - 90)
    stage.put('warehouse.open-orders', OpenOrders((unknown, known, late)))

    def said(name: str) -> str:
        button = stage.page.get_by_role('button', name=name, exact=True)
        row = stage.page.locator('#orders tr.row').filter(has=button)
        return row.locator('td').last.text_content() or ''

    eventually(lambda: stage.page.locator('#orders tr.row').count() == 3, 60)
    assert said('late').startswith('+')
    assert (said('unknown'), said('known')) == ('–', 'on time')  # noqa: RUF001 (as on the page)


@pytest.mark.parametrize('width', [1440, 390])
def test_no_column_is_pushed_out_of_its_panel(stage: Stage, width: int) -> None:
    name = 'a-very-long-name-' * 10
    order = Order(name, 0, name, (OrderLine('L1', 'tea'),), time.time(), due_s=time.time() + 9000)
    stage.put('warehouse.open-orders', OpenOrders((order,)))
    stage.page.set_viewport_size({'width': width, 'height': 900})
    expect(stage.page.locator('#orders .row-name').first).to_have_attribute('title', name)
    too_wide = (
        "['orders', 'robots'].map((id) => document.getElementById(id))"
        '.filter((table) => table.scrollWidth > table.parentElement.clientWidth)'
        '.map((table) => table.id)'
    )
    found = stage.look(too_wide)
    stage.page.set_viewport_size({'width': 1440, 'height': 900})
    assert found == []


def test_a_page_touches_its_alive_file(stage: Stage, tmp_path: Path) -> None:
    alive = tmp_path / 'page.alive'
    with serve(stage.bench, '--alive', str(alive)) as server:
        eventually(alive.exists, 60)
        alive.unlink()
        eventually(alive.exists, 60)
        assert server.end() == 0, server.output()


@pytest.mark.parametrize('path', ['api/orders', 'api/commands', 'api/rate'])
def test_a_post_of_another_site_is_refused(stage: Stage, path: str) -> None:
    body = '{"command": "pause"}'
    ours = {'origin': stage.url.rstrip('/'), 'content-type': 'application/json'}
    for theirs, status in (
        ({'origin': 'http://evil.example'}, 403),
        ({'origin': 'null'}, 403),
        ({'host': 'evil.example'}, 421),
        ({'content-type': 'text/plain'}, 415),
    ):
        answer = httpx.post(stage.url + path, headers={**ours, **theirs}, content=body)
        assert answer.status_code == status, answer.text
    refused = httpx.post(stage.url + path, headers=ours, content='{"what": 1}')
    assert refused.status_code == 400
    assert 'what' in refused.json()['error']
    large = httpx.post(stage.url + path, headers=ours, content=b'x' * 100_000)
    assert large.status_code == 413


def test_another_pages_script_cannot_order_from_a_browser(stage: Stage, browser: Browser) -> None:
    before = stage.bench.end_offset('warehouse.commands')
    other = browser.new_page()
    other.route('http://evil.example/', lambda route: route.fulfill(body='<p>hello</p>'))
    other.goto('http://evil.example/')
    outcome = other.evaluate(
        """async (url) => {
            const outcomes = [];
            for (const type of ['application/json', 'text/plain']) {
                await fetch(url, {method: 'POST', headers: {'content-type': type},
                                  body: '{"command": "pause"}'})
                    .then(() => outcomes.push('read'), () => outcomes.push('refused'));
            }
            return outcomes;
        }""",
        stage.url + 'api/commands',
    )
    other.close()
    assert outcome == ['refused', 'refused']
    assert stage.bench.end_offset('warehouse.commands') == before


def test_what_is_old_is_said_and_the_page_comes_back_by_itself(stage: Stage) -> None:
    expect(stage.page.locator('#live')).to_have_text('Old data')  # nobody drives
    stage.kafka.stop()
    expect(stage.page.locator('.banner.warn')).to_contain_text('Kafka does not answer')
    stage.kafka.start()
    eventually(stage.is_live, 60)
    expect(stage.page.locator('.banner')).to_have_count(0)
