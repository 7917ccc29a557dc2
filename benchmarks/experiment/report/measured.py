"""What was measured, as tables to be asked: a row for each cell."""

from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import pandas as pd

from benchmarks.experiment.report.contestants import place, title
from benchmarks.experiment.report.paper import RATES, words
from benchmarks.experiment.results import Experiment, Result

OURS: Final = title('bridge', None)

# Of `cells.csv`, and where each column is found in a result.
_COLUMNS: Final = {
    'load': 'cell.load.name',
    'rate_orders_per_s': 'cell.load.rate',
    'burst_orders': 'cell.load.burst',
    'load_of_paper': 'cell.load.of_paper',
    'contestant': 'cell.contestant',
    'depth_messages': 'cell.depth',
    'length_s': 'cell.seconds',
    'at': 'at',
    **{
        f'{place}_orders': f'counts.{place}'
        for place in ('producer', 'kafka_ros', 'ros_kafka', 'consumer', 'lost')
    },
    'lost_share': 'counts.loss',
    'duplicated_orders': 'counts.duplicated',
    'out_of_order_orders': 'counts.out_of_order',
    'sent_orders_per_s': 'sent_per_s',
    'delivered_orders_per_s': 'delivered_per_s',
    **{
        f'latency_{name}_ms': f'latency.{name}'
        for name in ('first', 'fastest', 'median', 'p95', 'p99', 'p999', 'slowest')
    },
    **{f'hop_{name}_median_ms': f'hops.{name}' for name in ('to_ros', 'to_kafka', 'to_consumer')},
    **{
        f'{part}_{name}': f'{part}.{name}'
        for part in ('kafka_ros', 'ros_kafka', 'broker')
        for name in ('before_mib', 'peak_mib', 'cpu_s')
    },
    'cpu_ms_per_order': 'cpu_ms_per_order',
    'broker_share_of_cpu': 'broker_share',
    'problems': 'problems',
}


class Measured(NamedTuple):
    """An experiment, sorted.

    Args:
        cells: By load and contestant, each in the words for a reader: the columns of `cells.csv`,
            and what follows from them. What was not measured has no row.
        loads: The even ones from the slowest on, then as fast as possible, then bursts.
        runs: Contestants, with their depth where they have one, of which at least one cell was
            measured; without the recordings.
        of_paper: The loads of the paper, measured or not.
    """

    experiment: Experiment
    cells: pd.DataFrame
    loads: list[str]
    runs: list[str]
    of_paper: list[str]

    @property
    def depths(self) -> Sequence[int]:
        """The depths of KEEP_LAST that were measured."""
        return sorted(int(depth) for depth in self.cells['depth_messages'].dropna().unique())

    @property
    def contestants(self) -> Sequence[str]:
        """Those of which something was measured, the recording, too."""
        return sorted(self.cells['contestant'].unique(), key=lambda name: (place(name), name))

    @property
    def problems(self) -> Sequence[str]:
        """What went wrong with the measuring itself, with the cell."""
        results = self.experiment.results
        return [f'{one.cell.key}: {problem}' for one in results for problem in one.problems]

    @property
    def missing(self) -> Mapping[str, Sequence[str]]:
        """The loads that each contestant would have, had none been left out."""
        gaps = {
            run: [load for load in self.loads if (load, run) not in self.cells.index]
            for run in self.runs
        }
        return {run: loads for run, loads in gaps.items() if loads}

    def of(self, contestant: str) -> pd.DataFrame:
        """All cells of a contestant."""
        return self.cells[self.cells['contestant'] == contestant]

    def at(self, run: str, loads: Sequence[str]) -> pd.DataFrame:
        """What a contestant did under these loads; a row of nothing where it was not measured."""
        return self.cells.reindex([(load, run) for load in loads]).droplevel('Contestant')

    def at_paper_loads(self, contestant: str) -> pd.DataFrame:
        """The cells of a contestant at the paper's loads."""
        cells = self.of(contestant)
        return cells[cells.index.isin(self.of_paper, level='Load')]


def sort(experiment: Experiment) -> Measured:
    """Sort what was measured."""
    by_run = sorted(experiment.results, key=_run)
    results = sorted(by_run, key=_load)
    cells = _table(results)
    cells['result'] = pd.Series(list(results), dtype=object)
    cells['is_even'] = [one.cell.load.rate > 0 and one.cell.load.burst == 1 for one in results]
    cells['Load'] = [one.cell.load.words for one in results]
    cells['Contestant'] = [_title(one) for one in results]
    cells = cells.set_index(['Load', 'Contestant'])
    loads = cells.index.get_level_values('Load')
    bare = cells[cells['contestant'] == 'bare'].droplevel('Contestant')
    cells['bare_median_ms'] = loads.map(bare['latency_median_ms'].to_dict()).astype(float)
    cells['bare_p99_ms'] = loads.map(bare['latency_p99_ms'].to_dict()).astype(float)
    cells['ratio'] = cells['latency_p99_ms'] / cells['bare_p99_ms'].where(cells['bare_p99_ms'] > 0)
    cells['lost_before_ros'] = cells['producer_orders'] - cells['kafka_ros_orders']
    cells['lost_in_ros'] = cells['kafka_ros_orders'] - cells['ros_kafka_orders']
    cells['lost_behind_ros'] = cells['ros_kafka_orders'] - cells['consumer_orders']
    cells['broker_share'] = cells['broker_share_of_cpu'].where(cells['broker_cpu_s'] > 0)
    runs = dict.fromkeys(map(_title, by_run))
    return Measured(
        experiment,
        cells,
        loads=list(loads.unique()),
        runs=[run for run in runs if run != title('recording', None)],
        of_paper=[words(name) for name in RATES],
    )


def cells_csv(experiment: Experiment) -> str:
    """Write all that was measured but the curves; what is not there is empty."""
    cells = _table(experiment.results)
    cells['load_of_paper'] = cells['load_of_paper'].map({True: 'true', False: 'false'})
    cells['depth_messages'] = cells['depth_messages'].astype('Int64')
    cells['problems'] = cells['problems'].map('; '.join)
    return cells.to_csv(index=False, float_format='%.10g', lineterminator='\n')


def _table(results: Sequence[Result]) -> pd.DataFrame:
    columns = {name: [_read(one, path) for one in results] for name, path in _COLUMNS.items()}
    table = pd.DataFrame(columns)
    is_none_where_nothing_came = [name for name in columns if name.startswith(('latency', 'hop'))]
    return table.astype(dict.fromkeys(is_none_where_nothing_came, float))


def _read(result: Result, path: str) -> Any:
    found: Any = result
    for name in path.split('.'):
        found = getattr(found, name, None)
    return found


def _title(result: Result) -> str:
    return title(result.cell.contestant, result.cell.depth)


def _load(result: Result) -> tuple[bool, bool, float, str]:
    load = result.cell.load
    return load.burst > 1, load.rate <= 0, load.rate, load.name


def _run(result: Result) -> tuple[int, str, int]:
    cell = result.cell
    return place(cell.contestant), cell.contestant, cell.depth or 0
