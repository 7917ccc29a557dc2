"""What a page is made of. Each block is written once, and rendered as HTML and as Markdown."""

from collections.abc import Sequence
from typing import Literal, NamedTuple

from benchmarks.experiment.report.numbers import NONE

Tone = Literal['', 'good', 'bad', 'absent', 'again', 'ours']


class Text(NamedTuple):
    """What stands in one field of a table."""

    text: str
    tone: Tone = ''


ABSENT = Text('not measured', 'absent')
DASH = Text(NONE, 'absent')


class Column(NamedTuple):
    """Of a table.

    Args:
        group: Heading above those that stand together.
        is_words: Whether it is read, not compared: aligned to the left.
    """

    title: str
    group: str = ''
    is_words: bool = False


class Table(NamedTuple):
    """Rows of one length.

    Args:
        starts: Numbers of the rows at which a group begins.
        is_long: Whether a reader may want to fold it away.
    """

    name: str
    caption: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[Text]]
    notes: Sequence[str] = ()
    starts: Sequence[int] = ()
    is_long: bool = False
    kind: Literal['table'] = 'table'

    @property
    def groups(self) -> Sequence[tuple[str, int]]:
        """Headings above the columns, with the number of columns of each; none where none is."""
        spans: list[tuple[str, int]] = []
        for column in self.columns:
            if spans and column.group and spans[-1][0] == column.group:
                spans[-1] = (column.group, spans[-1][1] + 1)
            else:
                spans.append((column.group, 1))
        return spans if any(title for title, _ in spans) else []

    @property
    def edges(self) -> Sequence[int]:
        """Numbers of the columns with which a group begins."""
        groups = [column.group for column in self.columns]
        return [i for i in range(1, len(groups)) if groups[i] and groups[i] != groups[i - 1]]


class Plot(NamedTuple):
    """A picture.

    Args:
        name: Of its file, and prefix of its identifiers.
        says: What it shows, for those who cannot see it.
        svg: The whole document.
    """

    name: str
    caption: str
    says: str
    svg: str
    kind: Literal['plot'] = 'plot'


class Paragraph(NamedTuple):
    """Running words."""

    text: str
    kind: Literal['paragraph'] = 'paragraph'


class Points(NamedTuple):
    """A list."""

    texts: Sequence[str]
    kind: Literal['points'] = 'points'


class Code(NamedTuple):
    """To be typed."""

    text: str
    kind: Literal['code'] = 'code'


class Figure(NamedTuple):
    """A number that speaks for itself, and what it is."""

    value: str
    what: str
    tone: Tone = ''


class Figures(NamedTuple):
    """A few of them, side by side."""

    figures: Sequence[Figure]
    kind: Literal['figures'] = 'figures'


Block = Table | Plot | Paragraph | Points | Code | Figures


class Section(NamedTuple):
    """A part of the page under a heading."""

    name: str
    title: str
    blocks: Sequence[Block]


class Page(NamedTuple):
    """All of it."""

    title: str
    under_title: str
    sections: Sequence[Section]
