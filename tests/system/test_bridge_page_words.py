"""What the live page says and shows of a bridge that is made up."""

import time
from collections.abc import Iterator
from typing import Any, Final

import pytest
from browsers import CHROMIUM, MadeUp, chromium, shown
from monitors import report, snapshot
from playwright.sync_api import Browser, Locator, Page, expect

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

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason='no chromium: apt install chromium')


@pytest.fixture(scope='module')
def browser() -> Iterator[Browser]:
    with chromium() as found:
        yield found


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
