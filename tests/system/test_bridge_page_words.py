"""What the live page says and shows of a bridge that is made up."""

import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import pytest
from playwright.sync_api import Browser, Locator, Page, expect
from support.monitoring.browsers import CHROMIUM, MadeUp, chromium, opened, shown
from support.monitoring.monitors import Monitor, distribution, report, snapshot

from ros2_kafka_bridge.protocol.monitor import Report, RouteReport
from ros2_kafka_bridge.route.counters import Measures, Snapshot, State, Trouble

CONFIG: Final = """
name: made-up
kafka: {bootstrap.servers: localhost:9}
routes:
  - name: orders
    from: {kafka: orders}
    to: {ros: /orders, type: std_msgs/msg/String}
    format: text
  - name: returned
    from: {ros: /orders}
    to: {kafka: returned}
    format: text
"""
LINES: Final = """it => {
    const content = document.createRange();
    content.selectNodeContents(it);
    return content.getClientRects().length;
}"""
DASH: Final = '\N{EN DASH}'

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason='no chromium: apt install chromium')


@pytest.fixture(scope='module')
def browser() -> Iterator[Browser]:
    with chromium(20_000) as found:
        yield found


def moving(delay_s: float, each_second: int) -> Iterator[Report]:
    """Five minutes of a bridge whose first route moves."""
    now_s = time.time()
    for second in range(300):
        count = second * each_second
        measures = Measures(in_bridge=distribution(count, delay_s))
        orders = snapshot('orders', taken=count, confirmed=count, measures=measures)
        yield report(orders, snapshot('returned'), time_s=now_s - 300 + second)


def waiting(route: str, reason: str, **measures: Any) -> Snapshot:
    return snapshot(route, State.WAITING, reason=reason, measures=Measures(**measures))


def at(time_s: float) -> str:
    return time.strftime('%H:%M', time.gmtime(time_s))


def tile(page: Page, word: str) -> Locator:
    """The value and the note below a word at the top of the page."""
    return page.locator('.tile', has=page.get_by_role('heading', name=word, exact=True))


def test_what_would_match_stands_there_to_be_pasted(browser: Browser) -> None:
    cure = 'set to.qos: {durability: transient_local}'
    match = {'route': 'orders', 'node': '/reader', 'problem': 'does not match', 'cure': cure}
    topic: dict[str, Any] = {
        'name': '/orders', 'types': ['std_msgs/msg/String'], 'of_ros': False, 'publishers': [],
        'subscribers': [], 'routes': [{'route': 'orders', 'does': 'publishes'}],
        'matches': [match, match | {'problem': 'is another type', 'cure': 'set to.type'}],
    }  # fmt: skip
    graph = {'problem': '', 'seen_s': int(time.time()), 'topics': [topic]}
    told = MadeUp(CONFIG, report(snapshot('orders'), snapshot('returned')), graph=graph)
    with shown(browser, told, 'graph') as page:
        todo = page.locator('.topic .todo')
        expect(todo).to_have_text(['Set to.qos: {durability: transient_local}', 'Set to.type.'])


@pytest.mark.parametrize('width', [1440, 1280, 1181, 820, 360])
def test_how_many_dead_letters_are_kept_is_not_cut_off(browser: Browser, width: int) -> None:
    letters = [{'topic': 'orders.dlq', 'routes': ['orders'], 'there': True, 'held': 3_142_592}]
    orders = snapshot('orders', dead_lettered=1_234_567)
    told = MadeUp(CONFIG, report(orders, snapshot('returned')), letters=letters)
    with shown(browser, told, viewport={'width': width, 'height': 800}) as page:
        dead = tile(page, 'Dead letters')
        expect(dead.locator('.value')).to_have_text('1,234,567')
        note = dead.locator('.note')
        expect(note).to_have_text('since the workers started; 3,142,592 kept')
        hidden = 'it => [it.scrollWidth - it.clientWidth, it.scrollHeight - it.clientHeight]'
        assert note.evaluate(hidden) == [0, 0]


def test_on_a_telephone_each_number_stands_by_its_word_and_in_its_card(browser: Browser) -> None:
    told = MadeUp(CONFIG, *moving(0.2, 1200))
    with shown(browser, told, viewport={'width': 360, 'height': 780}) as page:
        row = page.locator('#routes tbody tr', has_text='orders → /orders')
        expect(row.locator('.latency .value')).to_have_text(re.compile(r'\d{3} ms / \d{3} ms'))
        number, cell = (
            row.locator('.rate .value').bounding_box(),
            row.locator('.rate').bounding_box(),
        )
        assert number is not None
        assert cell is not None
        assert number['x'] == cell['x']
        assert number['y'] + number['height'] + 20 > cell['y'] + cell['height']
        edge = 'it => it.closest("tr").getBoundingClientRect().right - 12'
        for value in row.locator('.value').all():
            box = value.bounding_box()
            assert box is not None
            assert box['x'] + box['width'] <= value.evaluate(edge)


def test_a_chart_says_from_when_to_when_it_goes(browser: Browser) -> None:
    told = MadeUp(CONFIG, *moving(0.2, 1200))
    with shown(browser, told, timezone_id='UTC') as page:
        page.locator('#routes .link', has_text='orders').click()
        charts = page.locator('#drawer .times')
        expect(charts).to_have_count(2)
        before, after = time.time() - 60, time.time()
        began, ended = charts.first.locator('time').all_inner_texts()
        assert ended[-5:] in {at(before), at(after)}
        assert began[-5:] in {at(before - 600), at(after - 600)}


def test_behind_what_a_route_waits_for_stands_what_can_have_led_to_it_alone(
    browser: Browser,
) -> None:
    now_s = time.time()
    refused = Trouble(now_s - 50, 'TransportError', 'Kafka does not let it into its group', 1)
    later = tuple(
        Trouble(now_s - 20, error, f'orders[0]@3: {error}', 1)
        for error in ('DecodeError', 'EncodeError', 'RecordTooLargeError')
    )
    told = MadeUp(
        CONFIG,
        report(
            waiting('orders', 'Kafka is away', troubles=(refused, *later)),
            waiting('returned', 'Kafka is away', troubles=later),
        ),
    )
    with shown(browser, told) as page:
        said = page.locator('.attention li .note')
        well = 'It goes on by itself once that has ended. What comes meanwhile waits in Kafka, '
        well += 'as long as that keeps it.'
        led = re.compile(rf'{well} Last error, [0-9: -]+: Kafka does not let it into its group')
        expect(said).to_have_text([led, re.compile('lose that are not reliable and KEEP_ALL.$')])


def test_what_does_not_match_is_said_of_a_route_that_waits_as_well(browser: Browser) -> None:
    returned = snapshot('returned', measures=Measures(mismatched=2))
    orders = waiting('orders', '0 of 1 subscribers are there', mismatched=1)
    with shown(browser, MadeUp(CONFIG, report(returned, orders))) as page:
        rows = page.locator('.attention li')
        expect(rows.locator('.chip')).to_have_text(['waiting', 'mismatch', 'mismatch'])
        expect(rows.locator('.link')).to_have_text(['orders', 'orders', 'returned'])
        expect(rows.locator('p:not(.note)')).to_have_text(
            [
                '0 of 1 subscribers are there',
                '1 DDS endpoint on its topic does not match it',
                '2 DDS endpoints on its topic do not match it',
            ]
        )


def test_what_kafka_told_before_it_went_away_is_shown_as_that(browser: Browser) -> None:
    topic = {'name': 'orders', 'problem': '', 'leaderless': 0, 'under_replicated': 0}
    seen: dict[str, Any] = {
        'problem': '', 'seen_s': 1_750_000_000, 'cluster_id': 'abc', 'controller': 1,
        'brokers': [{'id': 1, 'address': 'localhost:9'}], 'round_trip_s': 0.1, 'topics': [topic],
    }  # fmt: skip
    told = report(snapshot('orders'), snapshot('returned'))
    away = MadeUp(CONFIG, told, broker=seen | {'problem': 'no broker answers'})
    with shown(browser, away, 'system', timezone_id='UTC') as page:
        kafka = page.locator('#broker')
        expect(kafka).to_contain_text('Kafka last answered at 2025-06-15 15:06:40.')
        expect(kafka).to_contain_text('1, all well then')
        expect(kafka).not_to_contain_text('asked')
    with shown(browser, MadeUp(CONFIG, told, broker=seen), 'system', timezone_id='UTC') as page:
        kafka = page.locator('#broker')
        expect(kafka).to_contain_text('at 2025-06-15 15:06:40, answered in 100 ms')
        expect(kafka.locator('dd').last).to_have_text('1, all well')
        expect(kafka).not_to_contain_text('then')


@pytest.mark.parametrize(
    ('lags', 'value', 'note'),
    [
        ((None, None), DASH, 'not known'),
        ((1200, None), '1,200', 'most: orders; 1 route not known'),
        ((0, None), '0', 'records behind; 1 route not known'),
        ((7, 5), '12', 'most: orders'),
    ],
)
def test_a_lag_that_is_not_known_is_not_none(
    browser: Browser, lags: tuple[int | None, int | None], value: str, note: str
) -> None:
    more = CONFIG.partition('  - name: returned')[0].partition('routes:\n')[2]
    names = ('orders', 'bills')
    orders, bills = (snapshot(name, lag=lag) for name, lag in zip(names, lags, strict=True))
    told = MadeUp(
        CONFIG + more.replace('orders', 'bills'), report(orders, bills, snapshot('returned'))
    )
    with shown(browser, told) as page:
        lag = tile(page, 'Lag in Kafka')
        expect(lag.locator('.value')).to_have_text(value)
        expect(lag.locator('.note')).to_have_text(note)
        page.locator('#routes .link', has_text='bills').click()
        now = DASH if lags[1] is None else lags[1]
        expect(page.locator('#drawer .chart .note').last).to_contain_text(f'now {now}, most')


def test_a_route_without_a_type_of_its_own_says_whose_it_has(browser: Browser) -> None:
    with shown(browser, MadeUp(CONFIG, report(snapshot('returned')))) as page:
        page.locator('#routes .link', has_text='returned').click()
        expect(page.locator('#drawer')).to_contain_text('the type of its publishers as text')


@pytest.mark.parametrize('width', [1280, 360])
def test_two_times_stand_in_one_line_of_the_drawer(browser: Browser, width: int) -> None:
    told = MadeUp(CONFIG, *moving(0.2, 1200))
    with shown(browser, told, viewport={'width': width, 'height': 800}) as page:
        page.locator('#routes .link', has_text='orders').click()
        times = page.locator('#drawer dd', has_text=re.compile(r'\d ms / \d+ ms'))
        expect(times).to_have_count(2)
        assert [it.evaluate(LINES) for it in times.all()] == [1, 1]


def test_while_a_lag_is_not_known_its_chart_shows_nothing_else(browser: Browser) -> None:
    now_s = time.time()
    told = [
        report(snapshot('orders', lag=lag, in_flight=held), time_s=now_s + second)
        for second, lag, held in ((-90, 50, 0), (-80, 40, 0), (-20, None, 400), (0, None, 400))
    ]
    with shown(browser, MadeUp(CONFIG, *told)) as page:
        page.locator('#routes .link', has_text='orders').click()
        expect(page.locator('#drawer .chart .note').last).to_have_text(f'now {DASH}, most 50')


def test_what_was_published_and_nobody_confirms_is_shown_as_that_alone(browser: Browser) -> None:
    now_s = time.time()
    told = [
        report(
            snapshot('orders', published=2000 * second, measures=Measures(bytes_published=2048)),
            snapshot('returned', confirmed=1000 * second),
            time_s=now_s + second,
        )
        for second in range(2)
    ]
    facts = '#drawer section:first-child dt, #drawer section:first-child dd'
    with shown(browser, MadeUp(CONFIG, *told)) as page:
        expect(tile(page, 'Messages a second').locator('.value')).to_have_text('3,000')
        page.locator('#routes .link', has_text='orders').click()
        expect(page.locator(facts)).to_have_text(
            [
                'taken', '0', 'confirmed', '0', 'published, not confirmed', '2,000',
                'dead-lettered', '0', 'in flight', '0', 'bytes confirmed', '0 B',
                'bytes published', '2.0 KiB',
            ]
        )  # fmt: skip
        page.keyboard.press('Escape')
        page.locator('#routes .link', has_text='returned').click()
        expect(page.locator('#drawer h2')).to_have_text('returned')
        expect(page.locator('#drawer .groups')).not_to_contain_text('published')


def test_what_is_not_known_is_drawn_as_no_number(
    browser: Browser, tmp_path: Path, ros_domain: int
) -> None:
    """Before the first report, after one, and of topics that Kafka does not show."""
    assert ros_domain
    silent_bridge = Monitor(
        f'{CONFIG}\nmonitoring: {{node: false}}', tmp_path / 'bridge.yaml', tmp_path / 'log'
    )
    with silent_bridge, opened(browser, silent_bridge.url) as page:
        expect(page.locator('#live')).to_have_text('No report yet')
        expect(page.locator('#banner')).to_contain_text('The bridge has told nothing yet')
        tiles = page.locator('.tile:not(:last-child)')
        expect(tiles.locator('.value')).to_have_text([DASH] * 6)
        expect(tiles.locator('.note')).to_have_text(['not known yet'] * 6)
        page.keyboard.press('4')
        expect(page.locator('#errors')).to_have_text('Not known yet.')
    hidden: dict[str, Any] = {'there': None, 'held': None, 'problem': 'authorization failed'}
    letters: list[dict[str, Any]] = [
        {'topic': 'kept', 'routes': ['orders'], 'there': True, 'held': 5, 'problem': ''},
        {'topic': 'hidden', 'routes': ['returned'], **hidden},
        {'topic': 'gone', 'routes': ['returned'], **hidden, 'there': False},
    ]
    returned = snapshot('returned', spooled=None, measures=Measures())
    bills = CONFIG.partition('routes:\n')[2].partition('  - name: returned')[0]
    silent = RouteReport(1, None, 0.0, snapshot('bills', State.STARTING, spooled=None))
    spool = '    spool: {path: /var/tmp/none, max_bytes: 5000000}\n'
    config = CONFIG + spool + bills.replace('orders', 'bills')
    broker = {'problem': '', 'seen_s': 1, 'brokers': [], 'round_trip_s': 0.1}
    told = report(snapshot('orders', lag=0, dead_lettered=2), returned, silent)
    with shown(browser, MadeUp(config, told, broker=broker, letters=letters)) as page:
        expect(page.locator('.tile .value')).to_have_text(
            ['2 / 3', DASH, '0', '0', DASH, '2', '0 brokers']
        )
        expect(page.locator('.tile .note')).to_have_text(
            [
                'none failed', '3 routes not known', '2 routes not known',
                'records behind; 1 route not known', 'not known yet',
                'since the workers started; 1 route not known; 5 kept; 1 topic not known',
                'asked in 100 ms',
            ]
        )  # fmt: skip
        row = page.locator('#routes tbody tr', has_text='bills')
        expect(row.locator('.value')).to_have_text([DASH] * 5)
        on_disk = page.locator('#routes tbody tr', has_text='returned').locator('.in_flight .sub')
        expect(on_disk).to_have_text(f'{DASH} on disk')
        page.locator('#routes .link', has_text='returned').click()
        for word, value in {
            'on disk': DASH, 'sink holds': DASH, 'DDS endpoints that match': DASH,
            'that do not match': DASH, 'held back by the sink': DASH,
        }.items():  # fmt: skip
            fact = page.locator('#drawer dt', has_text=re.compile(f'^{word}$'))
            expect(fact.locator('xpath=following-sibling::dd[1]')).to_have_text(value)
        expect(page.locator('#drawer .chart .note')).to_have_text(
            [re.compile(f'^now {DASH}, most {DASH} in'), f'now {DASH}, most {DASH}']
        )
        page.keyboard.press('Escape')
        page.locator('#routes .link', has_text='bills').click()
        expect(page.locator('#drawer')).to_contain_text('not told yet')
        page.keyboard.press('Escape')
        page.keyboard.press('3')
        boxes = page.locator('#letters .boxes button')
        expect(boxes.locator('b')).to_have_text(['5', DASH, 'none'])
        expect(boxes.nth(1)).to_contain_text('not to be seen: authorization failed')
        expect(boxes.nth(1)).to_be_enabled()
        expect(boxes.nth(2)).to_be_disabled()
    away = {'problem': 'no broker answers', 'seen_s': None}
    letters = [it | hidden | {'problem': away['problem']} for it in letters]
    with shown(browser, MadeUp(config, told, broker=away, letters=letters), 'letters') as page:
        expect(page.locator('#letters .empty')).to_have_text(
            'Nothing of these topics is known now: no broker answers'
        )
        expect(page.locator('#letters .boxes b')).to_have_text([DASH] * 3)
