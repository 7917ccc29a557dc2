"""packaging/kubernetes: objects that the API takes, and that fit together and to the bridge."""

import re
import subprocess
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any

import kubernetes_validate
import pytest
from ruamel.yaml import YAML
from support.install.checkout import ROOT, fenced

from ros2_kafka_bridge import __version__
from ros2_kafka_bridge.config.file import loads
from ros2_kafka_bridge.config.settings import Config, FromKafka, RosToKafkaRoute, ToKafka

PLACE = ROOT / 'packaging' / 'kubernetes'
CUSTOM = ('kafka.strimzi.io/', 'monitoring.coreos.com/', 'kustomize.config.k8s.io/')


def objects(path: str) -> Iterator[dict[str, Any]]:
    """What a file holds."""
    yield from YAML(typ='safe').load_all(PLACE / path)


def only(path: str) -> Any:
    """The one object of a file."""
    [found] = objects(path)
    return found


FILES = sorted(str(file.relative_to(PLACE)) for file in PLACE.rglob('*.yaml'))
OBJECTS = [found for file in FILES if file != 'bridge.yaml' for found in objects(file)]
KUSTOMIZATION = only('kustomization.yaml')
POD = only('deployment.yaml')['spec']['template']
[CONTAINER] = POD['spec']['containers']
[PORT] = CONTAINER['ports']
USER, TOPICS = only('user.yaml'), list(objects('topics.yaml'))
POLICY = only('pod-network/network-policy.yaml')['spec']


@pytest.fixture(scope='module')
def bridge() -> Config:
    return loads((PLACE / 'bridge.yaml').read_text(), 'bridge.yaml', {})


def volume(path: str) -> dict[str, Any]:
    """What is mounted where a file of the pod lies."""
    [name] = [
        mount['name']
        for mount in CONTAINER['volumeMounts']
        if PurePosixPath(path).is_relative_to(mount['mountPath'])
    ]
    [found] = [one for one in POD['spec']['volumes'] if one['name'] == name]
    return dict(found)


@pytest.mark.parametrize('version', ['1.30', '1.37'])
def test_the_api_takes_them_and_knows_every_field(version: str) -> None:
    own = [found for found in OBJECTS if not found['apiVersion'].startswith(CUSTOM)]
    assert {found['kind'] for found in own} == {
        'Deployment', 'PersistentVolumeClaim', 'NetworkPolicy',
    }  # fmt: skip
    for found in own:
        kubernetes_validate.validate(found, version, strict=True)


def test_what_is_there_is_used_and_what_is_used_is_there() -> None:
    [generated] = KUSTOMIZATION['configMapGenerator']
    named = {'kustomization.yaml', *KUSTOMIZATION['resources'], *generated['files']}
    for file in PLACE.glob('*/kustomization.yaml'):
        folder = file.parent.name
        assert f'- {folder} ' in _text('kustomization.yaml')
        own = only(f'{folder}/kustomization.yaml').get('resources', [])
        named |= {f'{folder}/{name}' for name in ('kustomization.yaml', *own)}
    assert named == set(FILES)


def test_one_word_names_what_is_one_bridges() -> None:
    """So that a second one in a namespace is a copy in which that word is another."""
    bridge = only('deployment.yaml')['metadata']['name']
    shared = {'KafkaTopic', 'Kustomization', 'Component'}
    assert {one['metadata']['name'] for one in OBJECTS if one['kind'] not in shared} == {bridge}
    [generated] = KUSTOMIZATION['configMapGenerator']
    assert generated['name'] == bridge
    assert volume('/etc/ros2-kafka-bridge/bridge.yaml')['configMap']['name'] == bridge
    claimed = volume('/var/lib/ros2-kafka-bridge')['persistentVolumeClaim']
    assert claimed['claimName'] == bridge
    selected = {'app.kubernetes.io/instance': bridge}
    assert selected.items() <= POD['metadata']['labels'].items()
    assert only('pod-monitor.yaml')['spec']['selector']['matchLabels'] == selected
    assert POLICY['podSelector']['matchLabels'] == selected
    assert only('deployment.yaml')['spec']['selector']['matchLabels'] == POD['metadata']['labels']


def test_the_image_is_that_of_this_version() -> None:
    [image] = KUSTOMIZATION['images']
    assert image['name'] == CONTAINER['image']
    assert image['newTag'] == __version__
    page = (ROOT / 'docs' / 'kubernetes.md').read_text()
    assert set(re.findall(rf'{image["newName"]}:(\S+)', page)) == {__version__}


def test_the_files_that_the_bridge_names_are_mounted(bridge: Config) -> None:
    for name, kind in (('ca', 'cluster'), ('certificate', 'user'), ('key', 'user')):
        path = PurePosixPath(str(bridge.kafka[f'ssl.{name}.location']))
        mounted = volume(str(path))
        assert mounted['name'] == kind
        assert path.name in {item['path'] for item in mounted['secret']['items']}
    [spool] = [route.spool for route in bridge.routes if isinstance(route, RosToKafkaRoute)]
    assert spool is not None
    assert volume(str(spool.path))['name'] == 'state'
    [writable] = [one['name'] for one in CONTAINER['volumeMounts'] if not one.get('readOnly')]
    assert writable == 'state'


def test_it_is_asked_where_it_answers(bridge: Config) -> None:
    assert bridge.monitoring is not None
    assert bridge.monitoring.listen == f'0.0.0.0:{PORT["containerPort"]}'
    asked = [CONTAINER[f'{kind}Probe']['httpGet'] for kind in ('startup', 'liveness', 'readiness')]
    assert [one['path'] for one in asked] == ['/livez', '/livez', '/readyz']
    [scraped] = only('pod-monitor.yaml')['spec']['podMetricsEndpoints']
    assert {one['port'] for one in (*asked, scraped)} == {PORT['name']}


def test_it_has_the_time_that_a_drain_takes(bridge: Config) -> None:
    needed_s = 2 * max(route.drain_s for route in bridge.routes) + 65
    assert POD['spec']['terminationGracePeriodSeconds'] > needed_s


def test_a_second_one_never_runs_beside_it() -> None:
    """It would write each message from ROS once more."""
    deployment = only('deployment.yaml')['spec']
    assert (deployment['replicas'], deployment['strategy']) == (1, {'type': 'Recreate'})
    # Recreate is for a change of the Deployment alone, not for a pod that is deleted or evicted.
    assert only('state.yaml')['spec']['accessModes'] == ['ReadWriteOncePod']


def test_the_alerts_find_the_job() -> None:
    label = only('pod-monitor.yaml')['spec']['jobLabel']
    alerts = (ROOT / 'packaging/prometheus/alerts.yaml').read_text()
    assert set(re.findall('job="(.*?)"', alerts)) == {POD['metadata']['labels'][label]}


def test_the_page_makes_a_rule_for_the_operator_of_the_alerts(tmp_path: Path) -> None:
    [lines] = [block for block in fenced('docs/kubernetes.md', 'sh') if 'PrometheusRule' in block]
    (tmp_path / 'packaging').symlink_to(ROOT / 'packaging')
    subprocess.run(['sh', '-ec', lines], cwd=tmp_path, check=True)
    [rule] = YAML(typ='safe').load_all(tmp_path / 'alerts.yaml')
    alerts = YAML(typ='safe').load(ROOT / 'packaging/prometheus/alerts.yaml')
    assert (rule['kind'], rule['spec']) == ('PrometheusRule', alerts)


def test_the_user_may_do_what_the_page_of_security_says_and_no_more() -> None:
    [lines] = [block for block in fenced('docs/security.md', 'sh') if 'kafka-acls.sh' in block]
    told = set()
    for line in re.sub(r'\\\n', ' ', lines).splitlines()[1:]:
        [(kind, name)] = re.findall(r'--(topic|group) (\S+)', line)
        pattern = 'prefix' if 'prefixed' in line else 'literal'
        told |= {(kind, name, pattern, what) for what in re.findall(r'--operation (\w+)', line)}
    given = {
        (on['type'], on['name'], on.get('patternType', 'literal'), operation)
        for acl in USER['spec']['authorization']['acls']
        for on, operation in ((acl['resource'], one) for one in acl['operations'])
    }
    created = {one for one in told if one[-1] == 'Create'}  # by Strimzi
    latched = {
        ('topic', name, 'literal', 'Read')
        for name in ('orders.returned', 'orders.returned.dead-letters')
    }
    assert given == (told - created) | latched


def test_all_topics_of_the_routes_are_made(bridge: Config) -> None:
    ends = [end for route in bridge.routes for end in (route.source, route.sink)]
    used = {name for end in ends for name in _topics(end)}
    assert {one['metadata']['name'] for one in TOPICS} == used


def test_the_policy_lets_through_what_the_bridge_needs(bridge: Config) -> None:
    [domain] = [int(one['value']) for one in CONTAINER['env'] if one['name'] == 'ROS_DOMAIN_ID']
    first = 7400 + 250 * domain  # RTPS, 9.6.1: the ports of a domain
    ports = {'protocol': 'UDP', 'port': first, 'endPort': first + 249}
    nodes = {'podSelector': {'matchLabels': {'ros2': f'domain-{domain}'}}}
    server = {'protocol': 'UDP', 'port': 11811}
    everybody = {'ipBlock': {'cidr': '239.255.0.1/32'}}  # RTPS, 9.6.1.4.1
    assert {'from': [nodes], 'ports': [ports]} in POLICY['ingress']
    assert {'to': [nodes, everybody], 'ports': [ports, server]} in POLICY['egress']
    [broker] = [rule['ports'] for rule in POLICY['egress'] if 'strimzi.io/kind' in str(rule['to'])]
    port = str(bridge.kafka['bootstrap.servers']).partition(':')[2]
    assert broker == [{'protocol': 'TCP', 'port': int(port)}]
    [asked] = [rule['ports'] for rule in POLICY['ingress'] if rule['ports'] != [ports]]
    assert asked == [{'protocol': 'TCP', 'port': PORT['name']}]


def test_all_is_of_one_cluster(bridge: Config) -> None:
    [cluster] = {one['metadata']['labels']['strimzi.io/cluster'] for one in (USER, *TOPICS)}
    assert str(bridge.kafka['bootstrap.servers']).startswith(f'{cluster}-kafka-bootstrap:')
    ours = volume('/etc/kafka/cluster/ca.crt')['secret']['secretName']
    assert ours == f'{cluster}-cluster-ca-cert'
    assert f'strimzi.io/cluster: {cluster}' in _text('pod-network/network-policy.yaml')
    assert volume('/etc/kafka/user/user.key')['secret']['secretName'] == USER['metadata']['name']


def _topics(end: object) -> list[str]:
    if not isinstance(end, (FromKafka, ToKafka)):
        return []
    return [end.kafka, f'{end.kafka}.dead-letters']


def _text(path: str) -> str:
    return (PLACE / path).read_text()
