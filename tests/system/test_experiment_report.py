"""The report of the experiment: what a reader finds in it, and that its numbers are the data's."""

import csv
import re
import sys
from collections.abc import Callable, Sequence
from html.parser import HTMLParser
from pathlib import Path

import msgspec
import pytest
from support.processes.terminal import finished

from benchmarks.experiment.grid import LOADS
from benchmarks.experiment.report import write_report
from benchmarks.experiment.report.__main__ import main
from benchmarks.experiment.report.goals import goals
from benchmarks.experiment.report.measured import sort
from benchmarks.experiment.report.numbers import digits, percent
from benchmarks.experiment.report.paper import SECONDS, published
from benchmarks.experiment.results import (
    SHARES,
    Cell,
    Experiment,
    Prediction,
    Result,
    StartUp,
    read,
    write,
)

ROOT = Path(__file__).parents[2]
GOLDEN = Path(__file__).with_name('golden') / 'experiment'
PLOTS = ('loss', 'latency', 'memory', 'throughput', 'predicted')
DEPTHS = {'paper': (10, 100, 200), 'keep_last': (10, 100, 200)}


def small() -> Experiment:
    """The experiment that is stored beside the golden files."""
    return read(GOLDEN / 'experiment.json')


def whole() -> Experiment:
    """All 72 cells, with the numbers of the small one."""
    measured = {one.cell.contestant: one for one in small().results}
    measured['keep_last'] = measured['paper']
    curved = timed(curve=[1 + 20 * share for share in SHARES])
    results = [
        msgspec.structs.replace(curved(measured[name]), cell=Cell(name, depth, load, 20.0))
        for load in LOADS
        for name in ('paper', 'bridge', 'keep_last', 'bare', 'recording')
        for depth in DEPTHS.get(name, (None,))
    ]
    runs = dict.fromkeys((one.cell.contestant, one.cell.depth) for one in results)
    starts = [StartUp(*run, (2.1, 2.25, 2.4)) for run in runs if run[0] != 'recording']
    predictions = [
        Prediction(load, depth, 0.41, 0.38, 0.44, seen=True, measured=0.4)
        for load in LOADS
        for depth in DEPTHS['paper']
    ]
    return Experiment(small().setting, results, predictions, starts)


def changed(name: str, load: str, change: Callable[[Result], Result]) -> Experiment:
    """The small experiment, but for one cell."""
    experiment = small()
    results = [
        change(one) if (one.cell.contestant, one.cell.load.name) == (name, load) else one
        for one in experiment.results
    ]
    assert results != experiment.results
    return msgspec.structs.replace(experiment, results=results)


def without(name: str, load: str) -> Experiment:
    experiment = small()
    kept = [
        one for one in experiment.results
        if (one.cell.contestant, one.cell.load.name) != (name, load)
    ]  # fmt: skip
    assert len(kept) < len(experiment.results)
    return msgspec.structs.replace(experiment, results=kept)


def words(experiment: Experiment, to: Path) -> str:
    """The report's, each paragraph in one line."""
    write_report(experiment, to)
    return (to / 'report.md').read_text().replace('\n', ' ')


def verdicts(experiment: Experiment) -> list[str]:
    return [goal.verdict for goal in goals(sort(experiment))]


def counted(**counts: int) -> Callable[[Result], Result]:
    return lambda one: msgspec.structs.replace(
        one, counts=msgspec.structs.replace(one.counts, **counts)
    )


def timed(**quantiles: float | Sequence[float]) -> Callable[[Result], Result]:
    def change(one: Result) -> Result:
        assert one.latency is not None
        quick = msgspec.structs.replace(one.latency, **quantiles)
        return msgspec.structs.replace(one, latency=quick)

    return change


def unheard(one: Result) -> Result:
    counts = msgspec.structs.replace(one.counts, consumer=0)
    return msgspec.structs.replace(one, counts=counts, latency=None)


@pytest.fixture(scope='module')
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the whole report is."""
    return write_report(whole(), tmp_path_factory.mktemp('report')).parent


# The files


def test_the_tables_are_those_of_the_golden_files(tmp_path: Path) -> None:
    write_report(small(), tmp_path)
    for name in ('report.md', 'cells.csv'):
        assert (tmp_path / name).read_text() == (GOLDEN / name).read_text(), name


def test_each_cell_has_a_line_and_each_column_a_name_in_the_csv(place: Path) -> None:
    experiment = whole()
    with (place / 'cells.csv').open(newline='') as file:
        lines = list(csv.DictReader(file))
    assert len(lines) == len(experiment.results) == 72
    assert [int(line['lost_orders']) for line in lines] == [
        one.counts.lost for one in experiment.results
    ]
    assert all(None not in line and None not in line.values() for line in lines)


def test_the_same_numbers_give_the_same_files(place: Path, tmp_path: Path) -> None:
    write_report(whole(), tmp_path)
    one, two = (
        {file.name: file.read_bytes() for file in folder.rglob('*.*')}
        for folder in (place, tmp_path)
    )
    assert one == two
    assert len(one) == 3 + len(PLOTS)


class _Page(HTMLParser):
    """What a page loads, and its identifiers."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loaded: list[str] = []
        self.ids: list[str] = []
        self.tags: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        for name, value in attrs:
            if name in {'src', 'href', 'xlink:href', 'srcset', 'data', 'action'}:
                self.loaded.append(value or '')
            if name == 'id':
                self.ids.append(value or '')


def test_the_page_needs_nothing_but_itself(place: Path) -> None:
    text = (place / 'report.html').read_text()
    page = _Page(text)
    assert page.loaded
    assert all(link.startswith('#') for link in page.loaded)
    assert {link[1:] for link in page.loaded} <= set(page.ids)
    assert len(page.ids) == len(set(page.ids))
    assert not page.tags & {'script', 'link', 'img', 'iframe', 'object'}
    assert not re.search(r'@import|url\((?!#)', text)
    assert '<?xml' not in text


def test_words_of_others_cannot_become_markup(tmp_path: Path) -> None:
    def change(one: Result) -> Result:
        return msgspec.structs.replace(one, problems=['<script>x</script> a | b\nc'])

    experiment = changed('bridge', '86', change)
    experiment.setting.machine['cpu'] = '<script>y</script>'
    command = msgspec.structs.replace(experiment.setting, command='x\n```\n<script>z</script>')
    page = write_report(msgspec.structs.replace(experiment, setting=command), tmp_path)
    assert 'script' not in _Page(page.read_text()).tags
    assert (
        '- 86-bridge: &lt;script>x&lt;/script> a \\| b c\n' in (tmp_path / 'report.md').read_text()
    )


@pytest.mark.parametrize('name', PLOTS)
def test_each_plot_has_its_lines_and_words_in_both_pages(place: Path, name: str) -> None:
    page = _Page((place / 'report.html').read_text())
    svg = (place / 'plots' / f'{name}.svg').read_text()
    lines = {
        'loss': [f'{who}-{depth}' for who in ('paper', 'bridge', 'bare') for depth in (10, 200)],
        'latency': ['paper-160', 'bridge-160', 'bare-5000', 'published-slowest-9.6'],
        'memory': ['paper-kafka_ros-160', 'bridge-ros_kafka-max'],
        'throughput': ['paper', 'bridge', 'keep_last', 'bare', 'all-of-it'],
        'predicted': ['depth-10', 'depth-100', 'depth-200', 'identity-10'],
    }[name]
    assert {f'{name}-{line}' for line in lines} <= set(page.ids)
    assert all(f'id="{name}-{line}"' in svg for line in lines)
    words = 'depth 100' if name == 'predicted' else "the paper's bridge"
    assert words in svg
    assert f'](plots/{name}.svg)' in (place / 'report.md').read_text()


# The goals and the headline


def test_all_goals_are_met_by_an_experiment_that_meets_them() -> None:
    assert verdicts(small()) == ['PASS'] * 5


@pytest.mark.parametrize(
    ('goal', 'load', 'change', 'why'),
    [
        (0, '1000', counted(consumer=19_999), '1,000 orders/s: 1 of 20,000 lost'),
        (1, '86', counted(duplicated=3), '86 orders/s: 3 of 1,720 repeated'),
        (2, '9.6', counted(out_of_order=2), '9.6 orders/s: 2 of 193 out of order'),
        (3, '160', timed(median=2.501), '160 orders/s: 2.501 ms (bare loops: 1.6 ms)'),
        (4, '86', timed(p99=3.61), '86 orders/s: 1.203 (3.61 ms against 3 ms)'),
    ],
)
def test_a_goal_that_is_missed_fails_and_names_the_cell(
    goal: int, load: str, change: Callable[[Result], Result], why: str
) -> None:
    experiment = changed('bridge', load, change)
    expected = ['PASS'] * 5
    expected[goal] = 'FAIL'
    assert verdicts(experiment) == expected
    assert goals(sort(experiment))[goal].why == why


@pytest.mark.parametrize('change', [timed(median=2.5), timed(p99=3.6)])
def test_a_goal_that_is_just_met_passes(change: Callable[[Result], Result]) -> None:
    assert verdicts(changed('bridge', '86', change)) == ['PASS'] * 5


def test_a_bridge_through_which_nothing_came_fails() -> None:
    experiment = changed('bridge', '86', unheard)
    assert verdicts(experiment) == ['FAIL', 'PASS', 'PASS', 'FAIL', 'FAIL']
    assert 'nothing came' in goals(sort(experiment))[3].why


def test_a_goal_does_not_pass_while_a_cell_is_missing() -> None:
    assert verdicts(without('bridge', '86')) == ['NOT MEASURED'] * 5
    assert verdicts(without('bridge', '1000')) == ['NOT MEASURED'] * 3 + ['PASS'] * 2
    assert verdicts(without('bare', '86')) == ['PASS'] * 4 + ['NOT MEASURED']


def test_a_cell_that_fails_outweighs_one_that_is_missing() -> None:
    experiment = without('bridge', '86')
    results = [
        counted(duplicated=1)(one) if one.cell.key == '160-bridge' else one
        for one in experiment.results
    ]
    assert verdicts(msgspec.structs.replace(experiment, results=results))[1] == 'FAIL'


def test_the_headline_says_what_the_data_say(tmp_path: Path) -> None:
    said = words(small(), tmp_path)
    assert "the paper's bridge lost 40.0 % of all orders: 8,000 of 20,000" in said
    assert '(1,000 orders/s, depth 10)' in said
    assert 'Ours lost 0, duplicated 0 and delivered 0 out of order, of 25,113 orders' in said
    spoilt = words(changed('bridge', '1000', counted(consumer=19_000)), tmp_path)
    assert 'Ours lost 1,000,' in spoilt


# What is not there


@pytest.mark.parametrize('load', ['9.6', 'max', 'bursts'])
def test_a_single_cell_makes_a_report(tmp_path: Path, load: str) -> None:
    one = [it for it in whole().results if it.cell.load.name == load][:1]
    write_report(Experiment(small().setting, one), tmp_path)
    text = (tmp_path / 'report.md').read_text()
    assert 'not measured' in text
    assert 'No loss was predicted.' in text
    assert '| No order is lost | **NOT MEASURED** |' in text


def test_no_cell_at_all_makes_a_report(tmp_path: Path) -> None:
    text = write_report(Experiment(small().setting, []), tmp_path).read_text()
    assert 'NOT MEASURED' in text


def test_cells_of_an_interrupted_run_are_named_as_not_measured(tmp_path: Path) -> None:
    write_report(without('bridge', '86'), tmp_path)
    text = (tmp_path / 'report.md').read_text()
    assert '- ours: 86 orders/s' in text
    assert re.search(r'86 orders/s +\| +51,683 .* not measured', text)


def test_a_cell_through_which_nothing_came_makes_a_report(tmp_path: Path) -> None:
    write_report(changed('paper', '160', unheard), tmp_path)
    assert '**nothing came**' in (tmp_path / 'report.md').read_text()
    assert '**100 %**' in (tmp_path / 'report.md').read_text()


# Numbers


def test_the_papers_losses_are_those_that_it_names_itself() -> None:
    ones = published()
    assert ones['lost_orders'].to_list() == [0, 90, 3469, 0, 230, 0]
    rates = ones.index.get_level_values('Load').str.removesuffix(' orders/s').astype(float)
    assert (abs(ones['producer_orders'] / SECONDS / rates - 1) < 0.04).all()


@pytest.mark.parametrize(
    ('value', 'text'),
    [
        (0, '0'),
        (3.0000, '3'),
        (1.6749, '1.67'),
        (0.04, '0.04'),
        (12_345.6, '12,346'),
        (9.6, '9.6'),
    ],
)
def test_numbers_have_the_digits_that_count(value: float, text: str) -> None:
    assert digits(value) == text


@pytest.mark.parametrize(
    ('share', 'text'),
    [
        (0, '0 %'), (1, '100 %'), (0.5, '50.0 %'), (0.0363, '3.63 %'),
        (1e-7, '< 0.001 %'), (0.99999, '> 99.9 %'),
    ],
)  # fmt: skip
def test_a_little_lost_is_never_nothing(share: float, text: str) -> None:
    assert percent(share) == text


def test_the_sentence_on_the_predictions_counts_intervals_and_names_the_worst(
    tmp_path: Path,
) -> None:
    good = Prediction(LOADS[2], 10, 0.10, 0.05, 0.15, seen=True, measured=0.12)
    bad = Prediction(LOADS[3], 100, 0.40, 0.35, 0.45, seen=False, measured=0.20)
    said = words(msgspec.structs.replace(small(), predictions=[good, bad]), tmp_path)
    assert '1 of 2 intervals' in said
    assert '+20.0 percentage points (1,000 orders/s, depth 100:' in said


# The command


def test_the_report_is_made_anew_from_a_file_or_its_directory(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path, small())
    assert main([str(tmp_path)]) == 0
    assert capsys.readouterr().out == f'{tmp_path}/report.html\n'
    made = (tmp_path / 'report.html').read_text()
    assert main([str(tmp_path / 'experiment.json'), '--to', str(tmp_path / 'two')]) == 0
    assert (tmp_path / 'two' / 'report.html').read_text() == made


def test_a_file_that_is_no_experiment_is_refused_in_words(tmp_path: Path) -> None:
    file = tmp_path / 'some.json'
    file.write_text('{"setting": 1}')
    done = finished([sys.executable, '-m', 'benchmarks.experiment.report', file], cwd=ROOT)
    assert done.returncode == 2
    assert done.stderr.startswith(f'{file}: is no stored experiment: ')
    assert 'Traceback' not in done.stderr


@pytest.mark.parametrize('content', [b'', b'no json', b'\xff\xfe'])
def test_a_file_of_anything_is_refused_in_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: bytes
) -> None:
    (tmp_path / 'experiment.json').write_bytes(content)
    assert main([str(tmp_path)]) == 2
    assert 'is no stored experiment' in capsys.readouterr().err


def test_a_place_without_results_is_refused_with_what_to_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert 'No such file' in said
    assert f'--out {tmp_path}' in said
