"""The report: the paper's figures beside those measured, as one page, as Markdown and as CSV.

`python -m benchmarks.experiment.report build/experiment`
"""

from pathlib import Path

from benchmarks.experiment.results import Experiment


def write_report(experiment: Experiment, place: Path) -> Path:
    """Write `report.html`, `report.md`, `cells.csv` and `plots/*.svg`; returns the first.

    Raises:
        OSError: It cannot be written.
    """
    # matplotlib is heavy, and a run that measures is disturbed by nothing.
    from benchmarks.experiment.report.cells import cells_csv  # noqa: PLC0415
    from benchmarks.experiment.report.found import find  # noqa: PLC0415
    from benchmarks.experiment.report.pages import PLOTS, as_html, as_markdown  # noqa: PLC0415
    from benchmarks.experiment.report.plots import plots  # noqa: PLC0415
    from benchmarks.experiment.report.sections import make_page  # noqa: PLC0415

    found = find(experiment)
    drawn = plots(found)
    page = make_page(found, drawn)
    files = {
        'report.html': as_html(page),
        'report.md': as_markdown(page),
        'cells.csv': cells_csv(experiment),
        **{f'{PLOTS}/{plot.name}.svg': plot.svg for plot in drawn.values()},
    }
    (place / PLOTS).mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (place / name).write_text(text, encoding='utf-8')
    return place / 'report.html'
