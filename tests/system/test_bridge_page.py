"""The live page in a real browser: with a real bridge under load, and with a hundred routes."""

import functools
import http.server
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Final

import httpx
import pytest
from playwright.sync_api import Browser, Page, expect
from ruamel.yaml import YAML
from support.bridges.routes import to_kafka, to_ros
from support.monitoring.browsers import CHROMIUM, chromium, opened
from support.monitoring.monitors import TOKEN, Stage
from support.processes.harness import Bench, eventually

from ros2_kafka_bridge.testing.local_kafka import free_port

Unique = Callable[[str], str]
WIDTHS: Final = ((1440, 900), (820, 1000), (360, 780))
VIEWS: Final = ('routes', 'graph', 'letters', 'errors', 'system')

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason='no chromium: apt install chromium')


@pytest.fixture(scope='module')
def browser() -> Iterator[Browser]:
    with chromium() as found:
        yield found


def unlock(page: Page, token: str = TOKEN) -> None:
    page.click('#unlock')
    page.fill('#box input', token)
    page.click('#box button.main')


# A made-up bridge in the real process


@pytest.fixture
def stage(tmp_path: Path, ros_domain: int) -> Iterator[Stage]:
    assert ros_domain
    with Stage(tmp_path, 12) as made:
        yield made


LONGEST_MS: Final = """async () => {
    const worst = [];
    new PerformanceObserver((list) => worst.push(...list.getEntries()
        .map((it) => it.duration))).observe({ type: 'longtask', buffered: false });
    await new Promise((done) => setTimeout(done, 4000));
    return Math.max(0, ...worst);
}"""


def test_a_hundred_routes_are_shown_smoothly_and_found(
    browser: Browser, tmp_path: Path, ros_domain: int
) -> None:
    assert ros_domain
    with Stage(tmp_path, 100) as stage, opened(browser, stage.monitor.url) as page:
        expect(page.locator('#routes tbody tr')).to_have_count(100)
        # A page that stands still does so each time, a busy machine does not.
        assert any(page.evaluate(LONGEST_MS) < 2000 for _ in range(3)), 'the page stands still'
        page.keyboard.press('/')
        page.keyboard.type('route_042')
        expect(page.locator('#routes tbody tr')).to_have_count(1)
        page.keyboard.press('Escape')
        page.select_option('#which', 'failed')
        expect(page.locator('#routes tbody tr')).to_have_count(2)
        page.select_option('#which', '')
        page.click('#routes thead .name button')
        expect(page.locator('#routes thead .name')).to_have_attribute('aria-sort', 'ascending')
        expect(page.locator('.attention li')).to_have_count(7)


@pytest.mark.parametrize('scheme', ['light', 'dark'])
def test_nothing_is_cut_off_on_any_screen(
    browser: Browser, stage: Stage, scheme: Any, tmp_path: Path
) -> None:
    for width, height in WIDTHS:
        size = {'width': width, 'height': height}
        with opened(browser, stage.monitor.url, viewport=size, color_scheme=scheme) as page:
            expect(page.locator('#routes tbody tr')).to_have_count(12)
            for view in VIEWS:
                page.goto(f'{stage.monitor.url}#{view}')
                expect(page.locator(f'#view-{view}')).to_be_visible()
                over = page.evaluate('document.documentElement.scrollWidth - innerWidth')
                assert over <= 0, (view, width)
                page.screenshot(path=tmp_path / f'{view}-{scheme}-{width}.png')
            ground = page.evaluate('getComputedStyle(document.body).backgroundColor')
            assert (ground == 'rgb(13, 16, 19)') == (scheme == 'dark')


def test_the_keyboard_is_enough(browser: Browser, stage: Stage) -> None:
    with opened(browser, stage.monitor.url) as page:
        unlock(page)
        expect(page.locator('#reload')).to_be_visible()
        page.keyboard.press('5')
        expect(page.locator('#view-system')).to_be_visible()
        page.keyboard.press('1')
        expect(page.locator('#view-routes')).to_be_visible()
        page.focus('#routes tbody tr:first-child .link')
        page.keyboard.press('Enter')
        drawer = page.locator('#drawer')
        expect(drawer).to_be_visible()
        expect(drawer).to_contain_text('route_000')
        assert page.evaluate("document.activeElement.closest('#drawer') !== null")
        page.keyboard.press('Escape')
        expect(drawer).to_be_hidden()
        assert page.evaluate('document.activeElement.textContent') == 'route_000'
        page.focus('#routes tbody tr:first-child .do button')
        page.keyboard.press('Enter')
        expect(page.locator('#routes tbody tr:first-child .state')).to_have_text('paused')
        focused = 'document.activeElement.getAttribute("aria-label")'
        assert page.evaluate(focused) == 'Resume route_000'


def test_it_is_read_only_until_the_token_is_given_once(browser: Browser, stage: Stage) -> None:
    with opened(browser, stage.monitor.url) as page:
        expect(page.locator('#locked')).to_have_text('Read-only until you unlock it')
        expect(page.locator('#routes tbody tr:first-child .do button')).to_be_hidden()
        expect(page.locator('#reload')).to_be_hidden()
        unlock(page, 'not-the-token-of-it')
        expect(page.locator('#box .error')).to_contain_text('this is not the token')
        page.fill('#box input', TOKEN)
        page.click('#box button.main')
        expect(page.locator('#box')).to_be_hidden()
        page.reload()
        page.click('#routes tbody tr:nth-child(2) .do button')
        expect(page.locator('#toast')).to_contain_text('route_001')
        expect(page.locator('#routes tbody tr:nth-child(2) .state')).to_have_text('paused')
        page.click('#reload')
        expect(page.locator('.changes li')).to_have_count(2)
        assert [it.do for it in stage.monitor.asked] == ['pause', 'preview']
        page.click('#box button.main')
        expect(page.locator('#toast')).to_contain_text('two routes')
        assert [it.do for it in stage.monitor.asked] == ['pause', 'preview', 'reload']
        assert page.evaluate('localStorage.length + document.cookie.length') == 0


def test_without_a_token_in_the_file_there_is_no_button(
    browser: Browser, tmp_path: Path, ros_domain: int
) -> None:
    assert ros_domain
    with Stage(tmp_path, 3, token='') as stage, opened(browser, stage.monitor.url) as page:
        expect(page.locator('#locked')).to_have_text('Read-only')
        expect(page.locator('#unlock')).to_be_hidden()
        hint = page.locator('#locked').get_attribute('title') or ''
        assert 'monitoring.token' in hint


@contextmanager
def another_site(place: Path) -> Iterator[str]:
    """A page of another origin on this machine; yields its address."""
    (place / 'index.html').write_text('<!doctype html><title>another</title><body></body>')
    handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=str(place))
    handler.keywords['directory'] = str(place)
    with http.server.ThreadingHTTPServer(('127.0.0.1', 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f'http://127.0.0.1:{server.server_port}/'
        server.shutdown()


ATTACK: Final = """async ([url, token]) => {
    const outcomes = [];
    const tried = async (path, options) => {
        try {
            const answer = await fetch(url + path, options);
            outcomes.push(answer.type === 'opaque' ? 'sent' : 'read');
        } catch { outcomes.push('refused'); }
    };
    const path = 'api/routes/route_000/pause';
    const json = { 'Content-Type': 'application/json' };
    await tried('api/state', {});
    await tried(path, { method: 'POST', headers: json, body: '{}' });
    const known = { ...json, Authorization: `Bearer ${token}` };
    await tried(path, { method: 'POST', headers: known, body: '{}' });
    await tried(path, { method: 'POST', headers: { 'Content-Type': 'text/plain' }, body: '{}' });
    await tried(path, { method: 'POST', mode: 'no-cors', credentials: 'include', body: '{}' });
    const form = Object.assign(document.createElement('form'), {
        method: 'POST', action: url + path, target: 'sink', enctype: 'text/plain',
    });
    const frame = Object.assign(document.createElement('iframe'), { name: 'sink' });
    document.body.append(frame, form);
    form.submit();
    const script = Object.assign(document.createElement('script'), { src: url + 'api/state' });
    const loaded = new Promise((done) => {
        script.onload = () => done('ran');
        script.onerror = () => done('refused');
    });
    document.body.append(script);
    outcomes.push(await loaded);
    const page = Object.assign(document.createElement('iframe'), { src: url });
    document.body.append(page);
    await new Promise((done) => setTimeout(done, 1500));
    return outcomes;
}"""


def test_a_page_of_another_site_can_neither_read_nor_order(
    browser: Browser, stage: Stage, tmp_path: Path
) -> None:
    place = tmp_path / 'site'
    place.mkdir()
    with another_site(place) as url, opened(browser, stage.monitor.url) as own:
        unlock(own)  # the attacked browser has the page open, unlocked
        expect(own.locator('#reload')).to_be_visible()
        other = own.context.new_page()
        other.goto(url)
        outcomes = other.evaluate(ATTACK, [stage.monitor.url, TOKEN])
        assert set(outcomes) <= {'refused', 'sent'}
        assert outcomes.count('sent') <= 1
        [*_, framed] = other.frames
        assert 'warehouse' not in framed.content()
    assert stage.monitor.asked == []


def test_a_page_whose_server_stands_still_says_so_and_comes_back(
    browser: Browser, stage: Stage
) -> None:
    with opened(browser, stage.monitor.url) as page:
        expect(page.locator('#live')).to_have_text('Not ready')  # a route of it has failed
        stage.monitor.process.send_signal(signal.SIGSTOP)
        try:
            expect(page.locator('#live')).to_have_text('Old data')
            expect(page.locator('#banner')).to_contain_text('does not answer')
        finally:
            stage.monitor.process.send_signal(signal.SIGCONT)
        expect(page.locator('#live')).to_have_text('Not ready')
        expect(page.locator('#banner')).to_be_hidden()


@contextmanager
def strangers(url: str, many: int) -> Iterator[None]:
    """So many others look at the page, from the address of the browser."""
    with ExitStack() as looking:
        for _ in range(many):
            looking.enter_context(httpx.stream('GET', f'{url}api/events', timeout=30))
        yield


def test_a_page_that_is_let_go_says_so_and_looks_again_when_it_is_told_to(
    browser: Browser, stage: Stage
) -> None:
    with opened(browser, stage.monitor.url) as page:
        banner, live = page.locator('#banner'), page.locator('#live')
        expect(live).to_have_text('Not ready')
        with strangers(stage.monitor.url, 50):
            expect(banner).to_contain_text('one that has looked for longest is let go')
            expect(live).to_have_text('Old data')
            page.click('#again')
            expect(banner).to_be_hidden()
            expect(live).to_have_text('Not ready')
        unlock(page)
        expect(page.locator('#reload')).to_be_visible()
        with strangers(stage.monitor.url, 60):
            page.wait_for_timeout(2000)  # it has a place of its own now
            expect(live).to_have_text('Not ready')
            expect(banner).to_be_hidden()


def test_a_page_whose_token_has_changed_goes_on_without(browser: Browser, stage: Stage) -> None:
    with opened(browser, stage.monitor.url) as page:
        page.evaluate("sessionStorage.setItem('ros2-kafka-bridge-token', 'the one before')")
        page.reload()
        expect(page.locator('#live')).to_have_text('Not ready')
        expect(page.locator('#locked')).to_have_text('Read-only until you unlock it')


# A real bridge, under load


def test_a_person_runs_a_real_bridge_from_the_page(
    browser: Browser, bench: Bench, unique: Unique, tmp_path: Path
) -> None:
    orders, returned = unique('orders'), unique('returned')
    bench.create_topic(orders, returned)
    port = free_port()
    monitoring = {'listen': f'127.0.0.1:{port}', 'token': TOKEN, 'node': False}
    routes = [to_ros(orders, '/orders'), to_kafka('/orders', returned)]
    config = bench.config(routes, monitoring=monitoring)
    late = ('--durability', 'transient_local')
    ended = threading.Event()

    def load() -> None:
        while not ended.wait(0.2):
            bench.produce(orders, [b'order %d' % number for number in range(50)])

    loading = threading.Thread(target=load)
    with bench.bridge(config) as bridge, bench.subscriber('/orders', tmp_path / 'x', *late):
        bridge.wait_for('subscribes to', 180)
        loading.start()
        try:
            with opened(browser, f'http://127.0.0.1:{port}/') as page:
                look_at_it(page)
                unlock(page)
                pause_and_resume(page)
                change_the_file(page, config)
                bench.produce(orders, [b'\xff\xfenot text <img src=x onerror=alert(1)>'])
                replay_a_letter(page)
        finally:
            ended.set()
            loading.join()
        assert bridge.end(60) == 0, bridge.output()


def look_at_it(page: Page) -> None:
    expect(page.locator('#live')).to_have_text('Ready')
    row = page.locator('#routes tbody tr', has_text='to_ros')
    expect(row.locator('.rate .value')).not_to_have_text('0')
    expect(row.locator('.latency .value')).to_contain_text('ms')
    expect(page.locator('.attention')).to_contain_text('does not match')
    page.click('nav a[href="#graph"]')
    topic = page.locator('.topic.wrong')
    expect(topic).to_contain_text('/orders')
    expect(topic).to_contain_text('volatile is offered, transient_local is asked for')
    expect(topic.locator('.todo')).to_have_text('Set to.qos: {durability: transient_local}')
    page.click('nav a[href="#system"]')
    expect(page.locator('#broker-state')).to_have_text('answers')
    page.click('nav a[href="#routes"]')


def pause_and_resume(page: Page) -> None:
    row = page.locator('#routes tbody tr', has_text='to_ros')
    row.locator('.do button').click()
    expect(row.locator('.state')).to_have_text('paused')
    expect(row.locator('.rate .value')).to_have_text('0')
    row.locator('.do button').click()
    expect(row.locator('.state')).to_have_text('running')
    expect(row.locator('.rate .value')).not_to_have_text('0')


def change_the_file(page: Page, config: Path) -> None:
    yaml = YAML(typ='safe')
    content = yaml.load(config.read_text())
    content['routes'][1]['drain_s'] = 5
    with config.open('w') as file:
        yaml.dump(content, file)
    page.click('#reload')
    expect(page.locator('.changes')).to_contain_text('to_kafka')
    expect(page.locator('.changes')).to_contain_text('drain_s')
    page.click('#box button.main')
    expect(page.locator('#box')).to_be_hidden()
    row = page.locator('#routes tbody tr', has_text='to_kafka')
    expect(row.locator('.state')).to_have_text('running')


def replay_a_letter(page: Page) -> None:
    page.click('nav a[href="#letters"]')
    button = page.locator('.boxes button:enabled').first
    expect(button).to_be_visible()
    shown, held = button.element_handle(), button.locator('b').inner_text()
    button.click()
    expect(button).to_have_attribute('aria-pressed', 'true')
    rows = page.locator('table.letters tbody tr')
    if not rows.count():
        eventually(lambda: reread(page, rows), 60)
    expect(rows.first).to_contain_text('DecodeError')
    rows.first.locator('.link').click()
    letter = page.locator('#letter')
    expect(letter).to_contain_text('ff fe 6e 6f')
    expect(letter.locator('img')).to_have_count(0)
    page.keyboard.press('Escape')
    rows.first.locator('input').check()
    page.click('#view-letters >> text=Replay 1…')
    page.check('#box label:has-text("would fail again") input')
    page.click('#box button.main')
    job = page.locator('#letters .panel').last
    expect(job).to_contain_text('1 letter would be replayed')
    job.locator('text=Replay them now').click()
    expect(job).to_contain_text('1 letter replayed to')
    expect(job.locator('.chip')).to_have_text('done')
    expect(rows.last).to_contain_text('to orders')
    # The box of the topic counts on, and whoever has got there by keyboard still is.
    expect(button.locator('b')).not_to_have_text(held)
    assert shown.evaluate('it => it.isConnected')


def reread(page: Page, rows: Any) -> bool:
    page.click('#view-letters >> text=Read again')
    page.wait_for_timeout(500)
    return bool(rows.count())
