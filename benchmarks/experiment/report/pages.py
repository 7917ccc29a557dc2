"""The page as HTML and as Markdown."""

from pathlib import Path
from typing import Final

from jinja2 import Environment, FileSystemLoader, StrictUndefined, select_autoescape

from benchmarks.experiment.report.blocks import Page, Text

PLOTS: Final = 'plots'
_VERDICTS: Final = frozenset({'PASS', 'FAIL', 'NOT MEASURED'})


def as_html(page: Page) -> str:
    """One page that needs nothing else."""
    return _environment().get_template('page.html.j2').render(page=page)


def as_markdown(page: Page) -> str:
    """The same; plots are files beside it."""
    text = _environment().get_template('page.md.j2').render(page=page, plots=PLOTS)
    return text.strip() + '\n'


def _environment() -> Environment:
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=select_autoescape(enabled_extensions=('html.j2',), default=False),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters['plain'] = _plain
    environment.filters['field'] = _field
    return environment


def _plain(text: str) -> str:
    """Words that Markdown takes for words; of one line."""
    for sign in '\\`*_|<[]#':
        text = text.replace(sign, '&lt;' if sign == '<' else f'\\{sign}')
    return ' '.join(text.split())


def _field(text: Text) -> str:
    """A field of a table; what is wrong, what is ours and every verdict in bold."""
    plain = _plain(text.text)
    return f'**{plain}**' if text.tone in {'bad', 'ours'} or text.text in _VERDICTS else plain
