"""The alert rules: right, complete, tried, and explained in the runbook."""

import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML
from support.monitoring.promql import asked, mistakes, told
from support.processes.terminal import finished

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / 'packaging' / 'prometheus'
NO_PROMTOOL = 'promtool is not here (apt-get install prometheus)'


def load(name: str) -> Any:
    return YAML(typ='safe').load((FOLDER / name).read_text())


def rules() -> list[dict[str, Any]]:
    return [rule for group in load('alerts.yaml')['groups'] for rule in group['rules']]


def alerts() -> dict[str, dict[str, Any]]:
    return {rule['alert']: rule for rule in rules() if 'alert' in rule}


def recorded() -> dict[str, frozenset[str]]:
    """The series of the recording rules, as those of a route."""
    of_a_route = told()['ros2_kafka_bridge_messages_taken_total']
    return {rule['record']: of_a_route for rule in rules() if 'record' in rule}


def promtool(*arguments: str) -> None:
    program = shutil.which('promtool')
    if program is None:
        pytest.skip(NO_PROMTOOL)
    done = finished([program, *arguments], cwd=FOLDER)
    assert done.returncode == 0, done.stdout + done.stderr


def test_prometheus_takes_the_rules_and_the_configuration() -> None:
    promtool('check', 'rules', 'alerts.yaml')
    promtool('check', 'config', 'prometheus.yaml')


def test_each_alert_fires_when_it_must_and_not_when_it_must_not() -> None:
    promtool('test', 'rules', 'alerts_test.yaml')


def test_no_alert_is_left_out_of_that() -> None:
    fires: set[str] = set()
    is_silent: set[str] = set()
    for group in load('alerts_test.yaml')['tests']:
        for case in group.get('promql_expr_test', ()):
            names = re.findall(r'alertname="(\w+)"', case['expr'])
            (fires if case['exp_samples'] else is_silent).update(names)
    assert fires == is_silent == set(alerts())


def test_the_healthy_stream_tells_all_that_alerts_ask_for() -> None:
    [healthy] = [it for it in load('alerts_test.yaml')['tests'] if 'healthy' in it['name']]
    given = {it['series'].partition('{')[0] for it in healthy['input_series']}
    wanted = {one.name for rule in rules() for one in asked(rule['expr'])}
    assert wanted - recorded().keys() == given


def test_rules_ask_only_for_what_a_scrape_has() -> None:
    wrong = {
        rule.get('alert', rule.get('record')): found
        for rule in rules()
        if (found := mistakes(rule['expr'], recorded()))
    }
    assert wrong == {}


@pytest.mark.parametrize('name', sorted(alerts()))
def test_an_alert_says_how_bad_it_is_what_happened_and_where_to_read_on(name: str) -> None:
    alert = alerts()[name]
    assert alert['labels']['severity'] in {'critical', 'warning', 'info'}
    words = alert['annotations']
    assert words.keys() == {'summary', 'description', 'runbook'}
    assert words['runbook'] == f'docs/runbook.md#{name.lower()}'
    assert words['summary'].endswith('.')
    assert '\n' not in words['summary']
    assert len(words['description'].split('. ')) >= 2
    of_metrics = frozenset[str]().union(*told().values())
    for text in words.values():
        assert set(re.findall(r'\$labels\.(\w+)', text)) <= of_metrics


def test_each_alert_has_a_section_in_the_runbook_and_each_section_an_alert() -> None:
    text = (ROOT / 'docs' / 'runbook.md').read_text()
    assert re.findall(r'^### (Ros2Kafka\w+)$', text, re.MULTILINE) == list(alerts())


def test_a_section_of_the_runbook_says_what_it_means_what_to_look_at_and_what_to_do() -> None:
    text = (ROOT / 'docs' / 'runbook.md').read_text()
    sections = re.split(r'^#+ ', text, flags=re.MULTILINE)
    of_alerts = [section for section in sections if section.startswith('Ros2Kafka')]
    for section in of_alerts:
        name = section.split('\n', 1)[0]
        parts = re.findall(r'^\*\*(\w+(?: \w+)?):\*\*', section, re.MULTILINE)
        assert parts == ['Means', 'Look', 'Do', 'Costs'], name
        severity = alerts()[name]['labels']['severity']
        assert f'*{severity}*' in section, name
