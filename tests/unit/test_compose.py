"""compose.yaml: all that it names is there, fits together, and is seen by this machine alone."""

import json
import re
from pathlib import PurePosixPath
from typing import Any

import pytest
from ruamel.yaml import YAML
from support.install.checkout import ROOT

from ros2_kafka_bridge.config.file import load
from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.testing.kafka_jars import POM

OWN = 'packaging/compose/bridge.yaml'
PROVISIONING = 'packaging/grafana/provisioning'
DASHBOARD = 'packaging/grafana/ros2-kafka-bridge.json'


def read(path: str) -> Any:
    return YAML(typ='safe').load(ROOT / path)


SERVICES: dict[str, Any] = read('compose.yaml')['services']
KAFKA: dict[str, str] = SERVICES['kafka']['environment']
PROMETHEUS: dict[str, str] = dict(word.split('=') for word in SERVICES['prometheus']['command'])
GRAFANA: dict[str, str] = SERVICES['grafana']['environment']


def mounts(service: str) -> dict[str, str]:
    """What a service sees: its path there, and the file of the checkout or the volume."""
    words = [text.split(':') for text in SERVICES[service].get('volumes', [])]
    return {word[1]: word[0] for word in words}


def shown(service: str, path: str) -> str:
    """The path in the checkout of what a service sees at a path."""
    found = [
        PurePosixPath(source) / PurePosixPath(path).relative_to(seen)
        for seen, source in mounts(service).items()
        if PurePosixPath(path).is_relative_to(seen)
    ]
    assert len(found) == 1, f'{service} has no {path}'
    return str(found[0])


@pytest.fixture(scope='module')
def bridge() -> Config:
    return load(ROOT / OWN, {})


def test_what_it_mounts_is_there_and_is_not_written() -> None:
    volumes = set(read('compose.yaml')['volumes'])
    for service in SERVICES.values():
        for text in service.get('volumes', []):
            source = text.partition(':')[0]
            assert source in volumes or ((ROOT / source).exists() and text.endswith(':ro')), text


def test_its_images_do_not_change_and_kafka_is_the_one_that_is_tested() -> None:
    for service in SERVICES.values():
        assert 'build' in service or re.search(r':v?\d+\.\d+\.\d+$', service['image'])
    [tested] = re.findall(r'kafka_[\d.]+</artifactId>\s*<version>(.*)</version>', POM.read_text())
    assert {SERVICES[name]['image'].rpartition(':')[2] for name in ('kafka', 'topics')} == {tested}


def test_nobody_beyond_this_machine_reaches_what_asks_for_no_password(bridge: Config) -> None:
    assert {service['network_mode'] for service in SERVICES.values()} == {'host'}
    assert bridge.monitoring is not None
    listen = {
        'kafka': KAFKA['KAFKA_LISTENERS'],
        'bridge': bridge.monitoring.listen,
        'prometheus': PROMETHEUS['--web.listen-address'],
        'grafana': GRAFANA['GF_SERVER_HTTP_ADDR'],
    }
    assert listen.keys() == SERVICES.keys() - {'topics'}
    for addresses in listen.values():
        for address in addresses.split(','):
            assert re.fullmatch(r'([A-Z]+://)?127\.0\.0\.1(:\d+)?', address)


def test_its_bridge_does_what_the_readme_shows() -> None:
    own, shown_there = read(OWN), read('examples/bridge.yaml')
    more = [own.pop('monitoring'), *(route.pop('spool', None) for route in own['routes'])]
    assert own == shown_there
    assert any(more[1:])


def test_its_bridge_reads_that_file_and_may_write_its_spools(bridge: Config) -> None:
    [command] = re.findall(r'^CMD (.*)', (ROOT / 'Containerfile').read_text(), re.MULTILINE)
    assert shown('bridge', json.loads(command)[-1]) == OWN
    assert SERVICES['bridge']['read_only']
    for route in bridge.routes:
        spool = getattr(route, 'spool', None)
        assert spool is None or shown('bridge', spool.path).startswith('bridge/')


def test_its_bridge_finds_its_kafka_and_the_topics_that_are_made(bridge: Config) -> None:
    *_, script = SERVICES['topics']['command']
    [made] = re.findall(r'for topic in (.*);', script)
    ends = [{**route['from'], **route['to']}['kafka'] for route in read(OWN)['routes']]
    assert sorted(made.split()) == sorted(ends)
    port = str(bridge.kafka['bootstrap.servers']).partition(':')[2]
    assert KAFKA['KAFKA_ADVERTISED_LISTENERS'] == f'PLAINTEXT://127.0.0.1:{port}'
    assert KAFKA['KAFKA_ADVERTISED_LISTENERS'] in KAFKA['KAFKA_LISTENERS'].split(',')
    assert f'--bootstrap-server 127.0.0.1:{port} ' in script
    assert f'grep -F {KAFKA["CLUSTER_ID"]} ' in script
    assert mounts('kafka')[KAFKA['KAFKA_LOG_DIRS']] == 'kafka'


def test_its_bridge_has_the_time_that_a_drain_takes(bridge: Config) -> None:
    needed_s = 2 * max(route.drain_s for route in bridge.routes) + 65
    assert float(SERVICES['bridge']['stop_grace_period'].removesuffix('s')) > needed_s


def test_prometheus_scrapes_that_bridge_for_the_alerts(bridge: Config) -> None:
    file = shown('prometheus', PROMETHEUS['--config.file'])
    settings = read(file)
    [job] = settings['scrape_configs']
    assert bridge.monitoring is not None
    assert job['static_configs'] == [{'targets': [bridge.monitoring.listen]}]
    assert [(ROOT / file).with_name(name).exists() for name in settings['rule_files']] == [True]


def test_grafana_has_the_dashboard_with_that_prometheus() -> None:
    [source] = read(f'{PROVISIONING}/datasources/prometheus.yaml')['datasources']
    dashboard = json.loads((ROOT / DASHBOARD).read_text())
    [chosen] = [one for one in dashboard['templating']['list'] if one['type'] == 'datasource']
    assert (chosen['query'], chosen['current']['value']) == (source['type'], 'default')
    assert source['isDefault']
    assert source['url'] == f'http://{PROMETHEUS["--web.listen-address"]}'
    every = read('packaging/prometheus/prometheus.yaml')['global']['scrape_interval']
    assert source['jsonData'] == {'timeInterval': every, 'manageAlerts': True}

    [provider] = read(f'{PROVISIONING}/dashboards/ros2-kafka-bridge.yaml')['providers']
    home = PurePosixPath(GRAFANA['GF_DASHBOARDS_DEFAULT_HOME_DASHBOARD_PATH'])
    assert str(home.parent) == provider['options']['path']
    assert shown('grafana', str(home)) == DASHBOARD
    for kind in ('dashboards', 'datasources'):
        assert shown('grafana', f'/etc/grafana/provisioning/{kind}') == f'{PROVISIONING}/{kind}'
