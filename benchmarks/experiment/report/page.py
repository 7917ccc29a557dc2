"""The report as Markdown, and as one page that needs nothing else: the same words, rendered."""

import html
import re
from collections.abc import Callable, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import pandas as pd
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markdown_it import MarkdownIt
from markdown_it.token import Token
from markupsafe import Markup

from benchmarks.experiment.report import numbers, paper
from benchmarks.experiment.report.contestants import contestant
from benchmarks.experiment.report.goals import goals, of_cells
from benchmarks.experiment.report.measured import OURS, Measured
from benchmarks.experiment.report.numbers import plain
from benchmarks.experiment.report.tables import points, tables, within
from benchmarks.experiment.results import Setting

PLOTS: Final = 'plots'
_HERE: Final = Path(__file__).parent
_FILTERS: Final = {
    form.__name__: form
    for form in (
        numbers.between, numbers.count, numbers.digits, numbers.duration, numbers.named,
        numbers.percent, of_cells, points,
    )
}  # fmt: skip

ShowTable = Callable[[str, pd.DataFrame, str], str]


def as_markdown(measured: Measured, plots: Mapping[str, str]) -> str:
    """Write the report; plots are files beside it."""
    return _write(measured, plots, _markdown_table)


def as_html(measured: Measured, plots: Mapping[str, str]) -> str:
    """Write it as a page, with the plots in it."""
    parser = MarkdownIt('commonmark').enable('table')
    parser.add_render_rule('image', lambda _, tokens, at, *__: _embedded(tokens[at], plots))
    tokens = parser.parse(_write(measured, plots, _html_table))
    sections = {}
    for heading, words in pairwise(tokens):
        if (heading.type, heading.tag) == ('heading_open', 'h2'):
            name = re.sub(r'\W+', '-', words.content.lower())
            heading.attrSet('id', name)
            sections[name] = words.content
    environment = Environment(loader=FileSystemLoader(_HERE), autoescape=True, trim_blocks=True)
    return environment.get_template('page.html.j2').render(
        title=tokens[1].content,
        css=(_HERE / 'page.css').read_text(),
        sections=sections,
        body=parser.renderer.render(tokens, parser.options, {}),
    )


def _environment() -> Environment:
    """For Markdown: every value is escaped but what is Markdown itself."""
    environment = Environment(
        loader=FileSystemLoader(_HERE),
        autoescape=False,  # noqa: S701 (that is for HTML)
        finalize=lambda value: value if isinstance(value, Markup) else plain(value),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= _FILTERS
    return environment


def _write(measured: Measured, plots: Mapping[str, str], show_table: ShowTable) -> str:
    setting, predictions = measured.experiment.setting, measured.experiment.predictions
    made = tables(measured)
    text = (
        _environment()
        .get_template('report.md.j2')
        .render(
            m=measured,
            setting=setting,
            machine=_machine(setting),
            paper=paper,
            published=paper.published(),
            depths=paper.TABLES,
            contestants=[contestant(name) for name in measured.contestants],
            goals=goals(measured),
            predictions=predictions,
            held=sum(map(within, predictions)),
            far=max(predictions, key=lambda one: abs(one.loss - one.measured), default=None),
            dash=numbers.NONE,
            worst=_worst,
            where=_where,
            table=lambda name, caption: _as_it_is(show_table(name, made[name], caption)),
            plots=plots,
            plot=lambda name, *words: _as_it_is(_plot(name, *words) if name in plots else ''),
        )
    )
    return re.sub(r'\n{3,}', '\n\n', text).strip() + '\n'


def _as_it_is(markdown: str) -> Markup:
    return Markup(markdown)  # noqa: S704 (the words in it are escaped)


def _worst(cells: pd.DataFrame) -> Any:
    """The cell that lost the largest share; None where there is no cell."""
    return None if cells.empty else cells.iloc[cells['lost_share'].argmax()]


def _where(cell: Any) -> str:
    """Name a cell: `160 orders/s, depth 10`."""
    depth = cell['depth_messages']
    return cell.name[0] if pd.isna(depth) else f'{cell.name[0]}, depth {depth:.0f}'


def _machine(setting: Setting) -> str:
    """Describe the machine: what is known by name first, then all else."""
    rest = dict(setting.machine)
    cores, cpu, memory = (rest.pop(name, None) for name in ('cores', 'cpu', 'memory_gib'))
    words = [] if cores is None else ['1 core' if cores == 1 else f'{cores} cores']
    words += [] if cpu is None else [f'of {cpu}' if words else str(cpu)]
    said = [' '.join(words)] if words else []
    said += [] if memory is None else [f'{memory} GiB']
    return ', '.join([*said, *(f'{name} {value}' for name, value in rest.items())]) or 'unknown'


# How what is no prose is shown


def _markdown_table(_name: str, table: pd.DataFrame, caption: str) -> str:
    columns = [column if isinstance(column, tuple) else ('', column) for column in table]
    before = ['', *(group for group, _ in columns)]
    headings = [
        f'**{group}**: {plain(name)}' if group and group != last else plain(name)
        for last, (group, name) in zip(before, columns, strict=False)
    ]
    words = [str(name) for name in table.index.names]
    flat = table.rename(index=_label).reset_index()
    flat.columns = pd.Index([*words, *headings])
    return f'**{plain(caption)}**\n\n' + flat.to_markdown(
        index=False,
        disable_numparse=True,
        colalign=['left'] * len(words) + ['right'] * len(headings),
    )


def _html_table(name: str, table: pd.DataFrame, caption: str) -> str:
    inline = MarkdownIt('commonmark', {'html': False}).renderInline
    rendered = table.map(inline).rename(index=lambda label: inline(_label(label)), columns=inline)
    shown = rendered.to_html(table_id=name, border=0, escape=False)
    region = f'<div class="scroll" tabindex="0" role="region" aria-label="{html.escape(caption)}">'
    return f'**{plain(caption)}**\n\n{region}\n{shown}\n</div>'


def _label(label: object) -> str:
    return f'**{label}**' if label == OURS else plain(label)


def _plot(name: str, says: str, caption: str) -> str:
    return f'![{plain(says)}]({PLOTS}/{name}.svg)\n\n*{plain(caption)}*'


def _embedded(token: Token, plots: Mapping[str, str]) -> str:
    """Put a plot where Markdown names its file, with words for who cannot see it."""
    says = html.escape(''.join(child.content for child in token.children or ()))
    svg = plots[Path(str(token.attrs['src'])).stem]
    labelled = svg.replace('<svg ', f'<svg role="img" aria-label="{says}" ', 1)
    return f'<span class="card">{labelled}</span>'
