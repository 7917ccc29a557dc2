"""The site that `make site` builds: whole, without others' help, and saying what the pages say."""

import re
from collections import Counter
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urldefrag, urlsplit

import pytest
from markdown_it import MarkdownIt
from mkdocs.config import load_config
from site_pages import BESIDE
from support.install.checkout import ROOT, build_site, pages


class Html(HTMLParser):
    """What a page of the site links to, loads, and offers as anchors.

    `elements` counts what its text is made of, without what the theme has added.
    """

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.anchors: set[str] = set()
        self.elements: Counter[str] = Counter()
        self._depth = 0
        self.feed(file.read_text())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note it."""
        has = {name: value or '' for name, value in attrs}
        self.anchors |= {has[name] for name in ('id', 'name') if name in has}
        if tag == 'a' and 'href' in has:
            self.links.append(has['href'])
        elif tag == 'link' and has.get('rel') != 'canonical':
            self.loads.append(has['href'])
        elif 'src' in has:
            self.loads.append(has['src'])
        if tag == 'article':
            self._depth += 1
        elif self._depth and has.get('class') != 'headerlink':
            self.elements[tag] += 1

    def handle_endtag(self, tag: str) -> None:
        """Leave the text of the page."""
        self._depth -= tag == 'article'


@pytest.fixture(scope='module')
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built one."""
    folder = tmp_path_factory.mktemp('site')
    build_site(folder)
    return folder


@pytest.fixture(scope='module')
def built(site: Path) -> dict[Path, Html]:
    """Each of its pages."""
    return {file: Html(file) for file in sorted(site.glob('**/*.html'))}


def on_site(page: Path) -> str:
    return BESIDE.get(page.name, page.name).replace('.md', '.html')


def test_each_page_is_there(site: Path) -> None:
    assert {file.name for file in site.glob('*.html')} == {'404.html', *map(on_site, pages())}
    assert (site / 'bridge.schema.json').exists()


def broken(site: Path, built: dict[Path, Html]) -> Iterator[str]:
    """Each link on the site that leads nowhere, there or into the repository."""
    config = load_config(str(ROOT / 'mkdocs.yml'))
    repository = str(config.repo_url)
    top = urlsplit(
        str(config.site_url)
    ).path  # the page for a wrong address cannot link relatively
    for file, html in built.items():
        for link in (*html.links, *html.loads):
            address, anchor = urldefrag(link)
            if address.startswith(repository):
                inside = re.sub(r'^/(blob|tree)/main/', '', address.removeprefix(repository))
                if not (ROOT / inside.strip('/')).exists():
                    yield f'{file.name}: {link}'
            elif not re.match(r'\w+:', address):
                root = site if address.startswith(top) else file.parent
                inside = unquote(address.removeprefix(top))
                target = (root / inside).resolve() if address else file
                known = built[target].anchors if target in built else set()
                if not target.exists() or unquote(anchor) not in known | {''}:
                    yield f'{file.name}: {link}'


def test_no_link_and_no_anchor_is_broken(site: Path, built: dict[Path, Html]) -> None:
    assert sum(len(html.links) for html in built.values()) > 3000
    assert list(broken(site, built)) == []


def test_nothing_is_fetched_from_others(built: dict[Path, Html]) -> None:
    loaded = {load for html in built.values() for load in html.loads}
    assert {load for load in loaded if re.match(r'\w+:|//', load)} == set()


@pytest.mark.parametrize('page', list(pages()), ids=lambda page: page.name)
def test_a_page_is_made_of_the_same_as_on_a_forge(page: Path, site: Path) -> None:
    """MkDocs reads lists and code in lists otherwise than forges do."""
    said = MarkdownIt('commonmark').enable('table').render(page.read_text())
    forge = Counter(re.findall(r'<(\w+)', said))
    here = Html(site / on_site(page)).elements
    kinds = ('h1', 'h2', 'h3', 'p', 'li', 'table', 'tr', 'td', 'pre', 'code', 'a', 'img', 'strong')
    assert {kind: here[kind] for kind in kinds} == {kind: forge[kind] for kind in kinds}


def test_a_reader_finds_each_page_by_its_kind() -> None:
    """Followed, used, looked up or read: the kinds of https://diataxis.fr."""
    nav = load_config(str(ROOT / 'mkdocs.yml')).nav or []
    kinds = ['Home', 'Tutorials', 'Guides', 'Reference', 'Explanation', 'Project']
    assert [next(iter(kind)) for kind in nav] == kinds
