"""What was measured, to be looked up; what was not is None."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from benchmarks.experiment.report.contestants import ORDER, contestant
from benchmarks.experiment.report.paper import RATES
from benchmarks.experiment.results import Experiment, Load, Result


class Run(NamedTuple):
    """A contestant, with its depth where it has one."""

    contestant: str
    depth: int | None

    @property
    def title(self) -> str:
        """As the report calls it."""
        words = contestant(self.contestant).title
        return words if self.depth is None else f'{words}, depth {self.depth}'


@dataclass(frozen=True)
class Found:
    """The results, by contestant and load.

    Args:
        loads: The even ones from the slowest on, then as fast as possible, then bursts.
        runs: Those of which at least one cell was measured, without the recordings.
    """

    experiment: Experiment
    results: Mapping[tuple[str, int | None, str], Result]
    loads: Sequence[Load]
    runs: Sequence[Run]

    def at(self, run: Run, load: str) -> Result | None:
        """Find what a contestant did under a load."""
        return self.results.get((*run, load))

    def of(self, name: str) -> Sequence[Result]:
        """All results of a contestant, by load and depth."""
        runs = [Run(*key[:2]) for key in self.results if key[0] == name]
        ordered = sorted(set(runs), key=_by_depth)
        found = (self.at(run, load.name) for load in self.loads for run in ordered)
        return [result for result in found if result]

    def one(self, name: str, load: str) -> Result | None:
        """What a contestant that has no depth did under a load."""
        return next((one for one in self.of(name) if one.cell.load.name == load), None)

    @property
    def of_paper(self) -> Sequence[Load]:
        """The loads of the paper, measured or not."""
        by_name = {load.name: load for load in self.loads}
        return [by_name.get(name) or paper_load(name) for name in RATES]


def find(experiment: Experiment) -> Found:
    """Sort the results."""
    results = {
        (one.cell.contestant, one.cell.depth, one.cell.load.name): one
        for one in experiment.results
    }
    loads = {one.cell.load.name: one.cell.load for one in experiment.results}
    runs = {Run(*key[:2]) for key in results if key[0] != 'recording'}
    return Found(
        experiment,
        results,
        sorted(loads.values(), key=_by_load),
        sorted(runs, key=lambda run: (_place(run), run.contestant, _by_depth(run))),
    )


def paper_load(name: str) -> Load:
    """Make a load of the paper, of which nothing was measured."""
    return Load(name, f'{name} orders/s', RATES[name], of_paper=True)


def where(result: Result) -> str:
    """Name a cell: `160 orders/s, depth 10`."""
    depth = '' if result.cell.depth is None else f', depth {result.cell.depth}'
    return f'{result.cell.load.words}{depth}'


def _by_load(load: Load) -> tuple[bool, bool, float, str]:
    return load.burst > 1, load.rate <= 0, load.rate, load.name


def _by_depth(run: Run) -> int:
    return run.depth or 0


def _place(run: Run) -> int:
    return ORDER.index(run.contestant) if run.contestant in ORDER else len(ORDER)
