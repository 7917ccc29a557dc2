"""The report: the paper's figures beside those measured, as one page, as Markdown and as CSV.

`python -m benchmarks.experiment.report build/experiment`
"""

from pathlib import Path

from benchmarks.experiment.results import Experiment


def write_report(experiment: Experiment, to: Path) -> Path:
    """Write `report.html`, `report.md`, `cells.csv` and `plots/*.svg`; returns the first.

    Raises:
        OSError: It cannot be written.
    """
    # pandas and matplotlib are heavy, and a run that measures is disturbed by nothing.
    from benchmarks.experiment.report.measured import cells_csv, sort  # noqa: PLC0415
    from benchmarks.experiment.report.page import PLOTS, as_html, as_markdown  # noqa: PLC0415
    from benchmarks.experiment.report.plots import draw  # noqa: PLC0415

    measured = sort(experiment)
    plots = draw(measured)
    files = {
        'report.html': as_html(measured, plots),
        'report.md': as_markdown(measured, plots),
        'cells.csv': cells_csv(experiment),
        **{f'{PLOTS}/{name}.svg': svg for name, svg in plots.items()},
    }
    (to / PLOTS).mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (to / name).write_text(text, encoding='utf-8')
    return to / 'report.html'
