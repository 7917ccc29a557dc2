"""The Grafana dashboard: whole, readable, and asking only for what a bridge tells."""

import itertools
import json
import re
from pathlib import Path
from typing import Any

import pytest
from support.monitoring.promql import asked, mistakes

from ros2_kafka_bridge.monitoring.prometheus import METRICS

FILE = Path(__file__).parents[3] / 'packaging' / 'grafana' / 'ros2-kafka-bridge.json'
DASHBOARD: dict[str, Any] = json.loads(FILE.read_text())
PANELS: list[dict[str, Any]] = DASHBOARD['panels']
SHOWN = [panel for panel in PANELS if panel['type'] != 'row']
WIDTH = 24


def expressions() -> list[str]:
    of_panels = [target['expr'] for panel in SHOWN for target in panel['targets']]
    of_notes = [note['expr'] for note in DASHBOARD['annotations']['list'] if 'expr' in note]
    return of_panels + of_notes


@pytest.mark.parametrize('expression', expressions())
def test_an_expression_asks_only_for_what_a_scrape_has(expression: str) -> None:
    assert mistakes(expression) == []


def test_every_metric_is_on_it() -> None:
    names = {one.name for expression in expressions() for one in asked(expression)}
    on_it = {re.sub('_(bucket|sum|count)$', '', name) for name in names}
    assert {metric.full_name for metric in METRICS} <= on_it


def test_every_expression_keeps_to_the_bridges_instances_and_routes_that_were_chosen() -> None:
    for expression in expressions():
        for one in asked(expression):
            chosen = {matcher.name: matcher.value for matcher in one.matchers}
            assert chosen.get('bridge') == '$bridge', expression
            assert chosen.get('instance') == '$instance', expression
            assert chosen.get('route', '$route') == '$route', expression


def test_routes_of_one_name_on_several_robots_stay_apart() -> None:
    for target in (target for panel in SHOWN for target in panel['targets']):
        for labels in re.findall(r'\bby \(([^)]*)\)', target['expr']):
            if 'route' in labels:
                assert labels.startswith('bridge, instance, route'), target['expr']
        if '{{route}}' in target['legendFormat']:
            assert '{{instance}}' in target['legendFormat'], target['expr']


def test_a_legend_and_the_variables_name_labels_that_are_there() -> None:
    known = {'bridge', 'instance', 'le'} | {label for metric in METRICS for label in metric.labels}
    for panel in SHOWN:
        for target in panel['targets']:
            assert set(re.findall(r'{{(\w+)}}', target['legendFormat'])) <= known
    names = {metric.full_name for metric in METRICS}
    variables = [v for v in DASHBOARD['templating']['list'] if v['type'] == 'query']
    for variable in variables:
        match = re.fullmatch(r'label_values\((\w+)(?:{(.*)})?, (\w+)\)', variable['definition'])
        assert match is not None, variable['definition']
        assert variable['query']['query'] == variable['definition']
        assert match[1] in names
        assert match[3] in known
        # Each keeps to what was chosen in those before it.
        before = variables[: variables.index(variable)]
        chosen = ','.join(f'{one["name"]}=~"${one["name"]}"' for one in before)
        assert (match[2] or '') == chosen


def test_a_style_of_its_own_is_for_a_legend_that_is_there() -> None:
    for panel in SHOWN:
        legends = [target['legendFormat'] for target in panel['targets']]
        for override in panel['fieldConfig']['overrides']:
            assert override['matcher']['id'] == 'byRegexp'
            pattern = override['matcher']['options']
            assert [it for it in legends if re.fullmatch(pattern, it)], panel['title']


def test_every_panel_and_target_asks_the_data_source_that_was_chosen() -> None:
    wanted = {'type': 'prometheus', 'uid': '${datasource}'}
    for panel in SHOWN:
        assert panel['datasource'] == wanted
        assert all(target['datasource'] == wanted for target in panel['targets'])
    assert DASHBOARD['templating']['list'][0]['type'] == 'datasource'


def test_panels_have_a_number_a_title_an_explanation_and_a_unit_of_their_own() -> None:
    numbers = [panel['id'] for panel in PANELS]
    assert len(numbers) == len(set(numbers))
    titles = [panel['title'] for panel in SHOWN]
    for panel in SHOWN:
        assert panel['title']
        assert panel['description'].endswith('.'), panel['title']
        assert panel['fieldConfig']['defaults']['unit'], panel['title']
        references = [target['refId'] for target in panel['targets']]
        assert len(references) == len(set(references))
    assert [t for t in titles if titles.count(t) > 1] == []


def test_no_panel_lies_on_another_or_outside() -> None:
    places = [(panel['title'], panel['gridPos']) for panel in PANELS]
    for title, place in places:
        assert 0 <= place['x'] < place['x'] + place['w'] <= WIDTH, title
        assert place['h'] > 0, title
    for (one, a), (other, b) in itertools.combinations(places, 2):
        apart = (
            a['x'] + a['w'] <= b['x']
            or b['x'] + b['w'] <= a['x']
            or a['y'] + a['h'] <= b['y']
            or b['y'] + b['h'] <= a['y']
        )
        assert apart, f'{one} lies on {other}'


def test_the_first_row_is_the_overview() -> None:
    rows = [panel['title'] for panel in PANELS if panel['type'] == 'row']
    assert rows == [
        'Overview', 'Traffic', 'Latency', 'Back-pressure and queues', 'DDS', 'Spool', 'Processes',
        'Errors',
    ]  # fmt: skip
