"""The page of the metrics tells those that there are."""

from pathlib import Path

from ros2_kafka_bridge.monitoring.prometheus import METRICS

PAGE = Path(__file__).parents[3] / 'docs' / 'metrics.md'


def table() -> str:
    """The metrics in Markdown."""
    rows = [
        f'| `{metric.full_name}` | {metric.kind} | {", ".join(metric.labels)} | {metric.help} |'
        for metric in METRICS
    ]
    return '\n'.join(['| metric | type | labels | what |', '|---|---|---|---|', *rows])


def test_each_metric_is_told_as_the_code_has_it() -> None:
    assert table() in PAGE.read_text(), f'put this table into {PAGE}:\n{table()}'
