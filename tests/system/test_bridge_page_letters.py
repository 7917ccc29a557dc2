"""What the live page shows of the letters of a topic, of a bridge that is made up."""

from collections.abc import Iterator
from typing import Any, Final

import pytest
from playwright.sync_api import Browser, expect
from support.monitoring.browsers import CHROMIUM, MadeUp, chromium, shown
from support.monitoring.monitors import report, snapshot

CONFIG: Final = """
name: made-up
kafka: {bootstrap.servers: localhost:9}
routes:
  - name: orders
    from: {kafka: orders}
    to: {ros: /orders, type: std_msgs/msg/String}
    format: text
"""

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason='no chromium: apt install chromium')


@pytest.fixture(scope='module')
def browser() -> Iterator[Browser]:
    with chromium(20_000) as found:
        yield found


@pytest.mark.parametrize(
    ('unseen', 'texts'),
    [
        ([], ['There are no letters.']),
        (['t[0] is not seen from offset 1 on'], ['t[0] is not seen from', 'No letters are seen.']),
    ],
)
def test_letters_that_are_not_seen_are_not_said_to_be_none(
    browser: Browser, unseen: list[str], texts: list[str]
) -> None:
    topic = {'topic': 't', 'routes': ['orders'], 'there': True, 'held': 21, 'problem': ''}
    found: dict[str, Any] = {
        'topic': 't', 'there': True, 'seen': 0, 'replayed': 0, 'unseen': unseen, 'letters': [],
    }  # fmt: skip
    broker = {'problem': '', 'seen_s': 1, 'brokers': [], 'round_trip_s': 0.1}
    told = report(snapshot('orders'))
    with shown(browser, MadeUp(CONFIG, told, broker=broker, letters=[topic]), 'letters') as page:
        page.route('**/api/dead-letters/*', lambda route: route.fulfill(json=found))
        page.click('#letters .boxes button')
        expect(page.locator('#letters .empty:visible')).to_contain_text(texts)
