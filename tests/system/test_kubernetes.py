"""packaging/kubernetes: the API knows it, and its bridge carries with the rights of its user."""

import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
from ruamel.yaml import YAML
from support.bridges.routes import lines, values
from support.install.checkout import ROOT
from support.install.schemas import problems
from support.kafka.secured import USER, Right, SecuredKafka, group_right, running, topic_right
from support.processes.harness import Bench, eventually
from support.processes.terminal import finished

from ros2_kafka_bridge import __version__

PLACE = ROOT / 'packaging' / 'kubernetes'
TOO_LARGE = 1_000_100
STRIMZI = '1.2.0'
COPY = 'org.apache.maven.plugins:maven-dependency-plugin:3.8.1:copy'


def manifest(path: str) -> list[dict[str, Any]]:
    return list(YAML(typ='safe').load_all(PLACE / path))


@pytest.fixture
def secured(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SecuredKafka]:
    with running(tmp_path_factory.mktemp('secured')) as kafka:
        yield kafka


@pytest.fixture
def bench(tmp_path: Path, secured: SecuredKafka, ros_domain: int) -> Bench:
    """The administration goes through the plain listener, past all permissions."""
    return Bench(tmp_path, secured.node.bootstrap_servers, ros_domain)


def rights(user: dict[str, Any]) -> Iterator[Right]:
    for acl in user['spec']['authorization']['acls']:
        on = acl['resource']
        if on['type'] == 'group':
            assert acl['operations'] == ['Read']
            yield group_right(on['name'], prefixed=on['patternType'] == 'prefix')
        else:
            assert on['type'] == 'topic'
            yield from (topic_right(on['name'], one.upper()) for one in acl['operations'])


def configured(bench: Bench, secured: SecuredKafka) -> Path:
    """bridge.yaml, with the files and addresses of this machine."""
    certificate, key = secured.client_certificate(USER)
    theirs = {
        'my-cluster-kafka-bootstrap:9093': secured.address('MUTUAL'),
        '/etc/kafka/cluster/ca.crt': secured.ca_file,
        '/etc/kafka/user/user.crt': certificate,
        '/etc/kafka/user/user.key': key,
        '/var/lib/ros2-kafka-bridge': bench.place,
        "'0.0.0.0:9464'": "'off'",
    }
    text = (PLACE / 'bridge.yaml').read_text()
    for name, own in theirs.items():
        assert name in text
        text = text.replace(name, str(own))
    file = bench.place / 'bridge.yaml'
    file.write_text(text)
    return file


def test_orders_and_letters_of_both_ways_go_through_with_the_rights_of_its_user(
    secured: SecuredKafka, bench: Bench
) -> None:
    [user] = manifest('user.yaml')
    for topic in manifest('topics.yaml'):
        bench.create_topic(topic['metadata']['name'], partitions=topic['spec']['partitions'])
    secured.allow(user['metadata']['name'], list(rights(user)))
    file = configured(bench, secured)
    status, out, err = bench.command('check', str(file), '--connect', timeout_s=60)
    assert (status, err) == (0, ''), out
    bench.produce('orders', [b'one', b'\xff', b'two'])
    seen = bench.place / 'seen'
    latched = ('--count', '3', '--durability', 'transient_local')
    with bench.subscriber('/orders', seen), bench.run(file) as bridge:
        eventually(lambda: lines(seen) == ['one', 'two'], 60, bridge.output)
        assert values(bench.records('orders.dead-letters', 1)) == [b'\xff']
        with bench.publisher('/orders_returned', *latched):
            assert values(bench.records('orders.returned', 3)) == [b'0', b'1', b'2']
        with bench.publisher('/orders_returned', '--count', '1', '--size', str(TOO_LARGE)):
            [letter] = bench.records('orders.returned.dead-letters', 1)
        assert 'max_message_bytes' in str(dict(letter.headers() or [])['dead_letter.error'])
        assert bridge.end() == 0
        assert 'ERROR' not in bridge.output()


@pytest.mark.parametrize('network', ['host-network', 'pod-network'])
def test_what_is_applied_is_known_to_the_api(network: str, tmp_path: Path) -> None:
    shown = {one['kind']: one for one in rendered(network, tmp_path)}
    assert {one['metadata']['namespace'] for one in shown.values()} == {'kafka'}
    for kind in ('ConfigMap', 'Deployment', 'PersistentVolumeClaim'):
        kubernetes_validate.validate(shown[kind], '1.37', strict=True)
    assert shown['ConfigMap']['data'] == {'bridge.yaml': (PLACE / 'bridge.yaml').read_text()}
    pod = shown['Deployment']['spec']['template']['spec']
    [container] = pod['containers']
    assert container['image'] == f'registry.example.org/ros2-kafka-bridge:{__version__}'
    of_node = network == 'host-network'
    assert pod.get('hostNetwork', False) is of_node
    assert pod.get('dnsPolicy') == ('ClusterFirstWithHostNet' if of_node else None)
    assert ('NetworkPolicy' in shown) is not of_node
    assert {'KafkaUser', 'KafkaTopic', 'PodMonitor'} <= shown.keys()


def rendered(network: str, place: Path) -> list[dict[str, Any]]:
    """What `kubectl apply -k` would apply, with one of the two networks."""
    renderer = shutil.which('kustomize'), shutil.which('kubectl')
    if not any(renderer):
        pytest.skip('cannot be rendered here: needs kustomize or kubectl')
    shutil.copytree(PLACE, place / 'copy')
    own = place / 'copy' / 'kustomization.yaml'
    lines = [line for line in own.read_text().splitlines() if '-network ' not in line]
    lines.insert(lines.index('configMapGenerator:'), f'  - {network}')
    own.write_text('\n'.join(lines))
    command = [renderer[0], 'build'] if renderer[0] else [renderer[1], 'kustomize']
    done = finished([str(word) for word in (*command, own.parent)])
    assert (done.returncode, done.stderr) == (0, '')
    return list(YAML(typ='safe').load_all(done.stdout))


@pytest.fixture(scope='module')
def strimzi(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    """What Strimzi publishes of its kinds, from the program that it makes that with."""
    place = tmp_path_factory.mktemp('strimzi')
    java = next((found for found in _javas() if _release(found) >= 21), None)
    if java is None or shutil.which('mvn') is None:
        pytest.skip('what Strimzi defines cannot be had here: needs Maven and Java 21')
    for jar in ('api', 'crd-generator'):
        _run(
            'mvn',
            '-B',
            COPY,
            f'-Dartifact=io.strimzi:{jar}:{STRIMZI}',
            f'-DoutputDirectory={place}',
        )
    kinds = {'KafkaUser': 'user', 'KafkaTopic': 'topic'}
    _run(
        java, '-cp', f'{place}/*', 'io.strimzi.crdgenerator.CrdGenerator', '--yaml',
        '--target-kube', '1.16+', '--crd-api-version', 'v1', '--api-versions', 'v1',
        '--storage-version', 'v1',
        *(f'io.strimzi.api.kafka.model.{n}.{kind}={place / kind}' for kind, n in kinds.items()),
    )  # fmt: skip
    return {kind: YAML(typ='safe').load(place / kind) for kind in kinds}


def _javas() -> Iterator[str]:
    yield from filter(None, [shutil.which('java')])
    yield from (str(found) for found in sorted(Path('/usr/lib/jvm').glob('*/bin/java')))


def _release(java: str) -> int:
    told = finished([java, '-version']).stderr
    found = re.search(r'version "(\d+)', told)
    return int(found[1]) if found else 0


def _run(*command: str) -> None:
    done = finished(command, timeout_s=200)
    assert done.returncode == 0, done.stdout + done.stderr


def test_strimzi_knows_every_field_of_its_user_and_topics(
    strimzi: dict[str, dict[str, Any]],
) -> None:
    for resource in [*manifest('user.yaml'), *manifest('topics.yaml')]:
        assert problems(strimzi[resource['kind']], resource) == []


def test_a_field_that_strimzi_does_not_know_would_be_found(
    strimzi: dict[str, dict[str, Any]],
) -> None:
    [user], [topic, *_] = manifest('user.yaml'), manifest('topics.yaml')
    user['spec']['authorization']['acls'][0]['resource']['pattern'] = 'prefix'
    topic['spec']['partitions'] = 'one'
    assert [len(problems(strimzi[one['kind']], one)) for one in (user, topic)] == [1, 1]
