"""The site of the documentation in a real browser."""

import re
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

import pytest
from playwright.sync_api import Browser, Page, expect
from support.install.checkout import build_site, pages
from support.monitoring.browsers import CHROMIUM, chromium, opened

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason='no chromium: apt install chromium')
PHONE = {'width': 390, 'height': 844}
# In the place of Mermaid, which the page with drawings asks the net for: as wide as it may be.
DRAWER = (
    'window.mermaid = {initialize() {}, render: async () => '
    '({svg: \'<svg width="100%" viewBox="0 0 2000 9"></svg>\'})}'
)


class Quiet(SimpleHTTPRequestHandler):
    """Any web server that has the folder."""

    def log_message(self, *_: object) -> None:
        """Say nothing."""


@pytest.fixture(scope='module')
def browser() -> Iterator[Browser]:
    with chromium(20_000) as found:
        yield found


@pytest.fixture(scope='module')
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of the built one."""
    folder = tmp_path_factory.mktemp('site')
    build_site(folder)
    server = ThreadingHTTPServer(('127.0.0.1', 0), partial(Quiet, directory=folder))
    Thread(target=server.serve_forever, daemon=True).start()
    yield f'http://127.0.0.1:{server.server_port}'
    server.shutdown()
    server.server_close()


@pytest.mark.parametrize(
    ('words', 'page', 'heading'),
    [
        ('Ros2KafkaSpoolFills', 'runbook.html', 'Ros2KafkaSpoolFills'),
        ('TLS', 'security.html', 'TLS'),
        ('docker', 'container.html', 'Docker'),
        ('replay dead letters', 'dead-letters.html', 'replay'),
    ],
)
def test_what_the_search_shows_first_is_the_place(
    browser: Browser, site: str, words: str, page: str, heading: str
) -> None:
    with opened(browser, f'{site}/index.html') as shown:
        shown.get_by_role('textbox', name='Search').press_sequentially(words)  # as a person types
        first = shown.locator('li.md-search-result__item').first
        expect(first.locator('a').first).to_have_attribute('href', re.compile(page))
        first.locator('a').filter(has_text=re.compile(heading)).first.click()
        shown.wait_for_url(re.compile(re.escape(page)))
        expect(shown.get_by_role('heading', name=re.compile(heading)).first).to_be_in_viewport()


def background(page: Page) -> int:
    """How bright it is, 0 to 255."""
    colour = page.evaluate('getComputedStyle(document.body).backgroundColor')
    return max(int(part) for part in re.findall(r'\d+', colour)[:3])


@pytest.mark.parametrize(('scheme', 'switch', 'is_dark'), [
    ('light', None, False), ('dark', None, True), ('light', 'Switch to dark', True),
])  # fmt: skip
def test_it_is_dark_where_the_system_is_or_the_reader_asks(
    browser: Browser, site: str, scheme: str, switch: str | None, *, is_dark: bool
) -> None:
    with opened(browser, f'{site}/index.html', color_scheme=scheme) as page:
        if switch:
            page.get_by_title('Switch to light').click()
            page.get_by_title(switch).click()
            page.reload()
        assert (background(page) < 64) == is_dark


def test_every_page_fits_a_phone(browser: Browser, site: str) -> None:
    names = ['index', *(page.stem for page in pages() if page.parent.name == 'docs')]
    with opened(browser, site, viewport=PHONE) as page:
        page.route('**/unpkg.com/**', lambda route: route.fulfill(body=DRAWER))
        wide = []
        for name in names:
            page.goto(f'{site}/{name}.html')
            if page.evaluate('document.documentElement.scrollWidth') > PHONE['width']:
                wide.append(name)
        page.locator('label[for=__search]:visible').first.click()  # a button there
        expect(page.get_by_role('textbox', name='Search')).to_be_visible()
    assert wide == []
    assert len(names) > 30
