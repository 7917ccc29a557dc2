"""What tests share: names and ROS domains of their own, and a real Kafka."""

import contextlib
import fcntl
import gc
import itertools
import os
import re
import shutil
import tempfile
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final

import pytest
from hypothesis import settings
from support.processes.harness import Bench
from support.processes.lifetimes import Leave
from support.registry.server import RegistryServer

from ros2_kafka_bridge.testing.kafka_node import new_id
from ros2_kafka_bridge.testing.local_kafka import QUICK_RETURN, LocalKafka

if TYPE_CHECKING:
    from support.kafka.shared import SharedKafka  # pytest imports it, to rewrite its asserts

pytest_plugins = (
    'support.gate.signals',
    'support.gate.limits',
    'support.gate.leak_check',
    'support.gate.reruns',
    'support.kafka.shared',
    'support.gate.skips',
)

# The same input each time; `make test-long` draws other ones once more.
settings.register_profile('same', deadline=None, derandomize=True)
settings.register_profile('random', deadline=None, print_blob=True)
settings.load_profile('same')

TESTS: Final = Path(__file__).parent
UNIT: Final = TESTS / 'unit'

# The ports of the other ids lie where Linux gives ports to clients.
ROS_DOMAINS: Final = (*range(1, 102), *range(215, 233))

# How long some modules take, in seconds, and how long a test of the others does about.
LONG: Final = {
    'faults/test_secured_kafka_faults': 355,
    'system/containers/test_image': 180,
    'system/containers/test_compose': 160,
    'system/test_foreign_errors': 300,
    'system/test_other_pythons': 250,
    'system/test_reload': 230,
    'faults/test_kafka_to_ros_kills': 185,
    'system/containers/test_release': 170,
    'system/test_ros_control': 155,
    'system/test_wheel': 150,
    'system/test_demo': 140,
    'system/test_bridge_page': 150,
    'faults/test_ros_to_kafka_kills': 95,
    'system/test_ros_workspace': 90,
    'system/test_workers': 120,
    'system/test_dead_letters': 115,
    'faults/test_network': 110,
    'system/warehouse/test_recovery': 105,
    'system/test_lifecycle': 100,
    'faults/test_take_over': 120,
    'integration/test_kills': 95,
    'system/test_secured_kafka': 95,
    'system/test_types_of_others': 150,
    'system/test_depth': 90,
    'system/test_monitoring': 90,
    'faults/test_worker_kills': 85,
    'system/test_local_kafka': 100,
    'system/test_systemd_unit': 60,
    'system/test_discovery_server': 45,
    'system/test_schema_from_graph': 45,
    'system/test_kubernetes': 70,
    'system/test_readme': 80,
    'system/test_examples': 75,
    'system/test_experiment': 85,
    'system/test_exclusive': 70,
    'faults/test_full_disk': 70,
    'faults/test_clock_jumps': 70,
    'system/test_tracing': 65,
    'faults/test_fault_bench': 65,
    'system/test_pause': 65,
    'integration/test_kafka_to_ros_beginnings': 60,
    'system/warehouse/test_tutorial': 65,
    'system/test_site': 60,
    'system/warehouse/test_own_module': 55,
    'faults/test_partition_kills': 55,
    'system/warehouse/test_chain': 50,
    'faults/test_spool_kills': 55,
    'integration/test_check': 50,
    'integration/test_python_program': 20,
    'system/test_topics': 50,
    'system/test_measures': 50,
    'faults/test_reload_kills': 45,
    'faults/test_cluster': 45,
    'system/test_tutorials': 60,
    'system/test_schema_registry': 40,
    'integration/test_ros_to_kafka': 40,
    'system/test_memory': 40,
    'system/test_init': 35,
    'system/test_bridge_page_words': 35,
    'system/test_drain': 35,
    'integration/test_reload': 35,
    'system/test_cli': 35,
    'system/test_hosts': 35,
    'integration/test_types_of_others': 35,
    'integration/test_ros_to_kafka_types': 35,
    'faults/test_spool_worker_kills': 35,
    'integration/test_kafka_to_ros': 30,
    'integration/test_workers': 30,
    'system/test_kafka_source': 30,
    'faults/test_fuzzed_records': 30,
    'integration/test_monitoring': 30,
    'integration/test_both_ways': 30,
    'integration/test_kafka_to_ros_bad_records': 30,
    'faults/test_cdr_kills': 30,
    'integration/test_cli': 25,
    'integration/test_dead_letters': 25,
    'faults/test_take_over_workers': 25,
    'integration/test_formats': 20,
    'integration/test_ros_to_kafka_bad_messages': 20,
    'integration/test_warehouse': 20,
    'integration/test_demo': 15,
    'integration/test_secured_kafka': 15,
    'integration/test_ros_control': 10,
}
USUAL: Final = 5


def pytest_configure(config: pytest.Config) -> None:
    """Make known the marks that only these tests have."""
    config.addinivalue_line(
        'markers', 'kills_kafka: its own Kafka is killed, and is to be back at once when started'
    )


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Give each worker a like share of the long tests first, the longest before the others.

    One that began last would leave the other workers idle. pytest-xdist (worksteal) cuts the
    list into as many parts as there are workers, and moves what is left at the end of one: the
    short tests.
    """
    workers = getattr(config, 'workerinput', {'workercount': 1})['workercount']
    if workers == 1:
        return
    modules = [list(tests) for _, tests in itertools.groupby(items, lambda item: item.path)]
    short = [item for item in items if UNIT in item.path.parents]
    long = [module for module in modules if UNIT not in module[0].path.parents]
    shares: list[list[pytest.Item]] = [[] for _ in range(workers)]
    taken = [0] * workers
    for module in sorted(long, key=_seconds, reverse=True):
        least = taken.index(min(taken))
        taken[least] += _seconds(module)
        shares[least] += module
    left = len(items)
    for number, share in enumerate(shares):
        room = max(0, left // (workers - number) - len(share))
        share.extend(short[:room])
        del short[:room]
        left -= len(share)
    items[:] = [*itertools.chain.from_iterable(shares), *short]


def pytest_collection_finish() -> None:
    """Keep the collector off the thousands of tests, which it would look through each time."""
    gc.collect()
    gc.freeze()


def _seconds(module: list[pytest.Item]) -> int:
    name = str(module[0].path.relative_to(TESTS).with_suffix(''))
    return LONG.get(name, USUAL * len(module))


@pytest.fixture(autouse=True, scope='session')
def _ros_stays_on_this_machine() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        yield


@pytest.fixture(autouse=True, scope='session')
def _processes_keep_what_python_compiles(
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[None]:
    # Where the environment forbids it, half of each start goes into compiling the same again.
    place = tmp_path_factory.getbasetemp()
    shared = place.parent if 'PYTEST_XDIST_WORKER' in os.environ else place
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv('PYTHONDONTWRITEBYTECODE', raising=False)
        patch.setenv('PYTHONPYCACHEPREFIX', str(shared / 'bytecode'))
        yield


@pytest.fixture
def own_kafka(
    request: pytest.FixtureRequest,
    kafka: 'SharedKafka',
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[LocalKafka]:
    """A real Kafka for one test, which may stop and start it; who kills it has `kills_kafka`."""
    place = tmp_path_factory.mktemp('kafka')
    _format_like(kafka.directory / 'data', place / 'data')
    is_killed = request.node.get_closest_marker('kills_kafka') is not None
    with LocalKafka(place, properties=QUICK_RETURN if is_killed else {}) as node:
        yield node
    shutil.rmtree(place, ignore_errors=True)


def _format_like(model: Path, data: Path) -> None:
    """Make the directory of a new node; Kafka's own tool takes as long for it as a start."""
    data.mkdir()
    shutil.copy(model / 'bootstrap.checkpoint', data)
    meta = (model / 'meta.properties').read_text()
    for name in ('cluster.id', 'directory.id'):
        meta = re.sub(rf'(?m)^{name}=.*$', f'{name}={new_id()}', meta)
    (data / 'meta.properties').write_text(meta)


@pytest.fixture
def unique() -> Callable[[str], str]:
    """Makes names that nobody else uses: `unique('orders')` is `orders-1f0c2a9e`."""
    return lambda stem: f'{stem}-{uuid.uuid4().hex[:8]}'


@pytest.fixture
def topic_name(unique: Callable[[str], str]) -> str:
    """The name of a Kafka topic that nobody else uses."""
    return unique('topic')


@pytest.fixture(scope='session')
def ros_domains() -> Iterator[int]:
    """The ROS domains in turn, so that one rests for as long as possible between two tests."""
    first = os.getpid() * 37 % len(ROS_DOMAINS)  # far from those of a run that began just now
    return itertools.cycle(ROS_DOMAINS[first:] + ROS_DOMAINS[:first])


@pytest.fixture
def ros_domain(ros_domains: Iterator[int], monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A ROS domain that no other test uses, not even one of another run on this machine.

    Processes that the test starts find it in ROS_DOMAIN_ID.
    """
    for domain in itertools.islice(ros_domains, len(ROS_DOMAINS)):
        claim = _claim(domain)
        if claim is not None:
            break
    else:
        pytest.fail('every ROS domain is in use on this machine')
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    yield domain
    os.close(claim)


def _claim(domain: int) -> int | None:
    """The open lock of a domain, None where another test holds it."""
    place = Path(tempfile.gettempdir(), f'ros2-kafka-bridge-tests-{os.getuid()}')
    place.mkdir(exist_ok=True)
    lock = os.open(place / f'ros-domain-{domain}', os.O_RDWR | os.O_CREAT, 0o600)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(lock)
        return None
    return lock


@pytest.fixture
def bench(tmp_path: Path, kafka: 'SharedKafka', ros_domain: int) -> Iterator[Bench]:
    """The Kafka of the run, a ROS domain of one's own, and a place for files."""
    with contextlib.closing(Bench(tmp_path, kafka.bootstrap_servers, ros_domain)) as made:
        yield made


@pytest.fixture
def own_bench(tmp_path: Path, own_kafka: LocalKafka, ros_domain: int) -> Iterator[Bench]:
    """The same with a Kafka of one's own, to be stopped and started."""
    with contextlib.closing(Bench(tmp_path, own_kafka.bootstrap_servers, ros_domain)) as made:
        yield made


@pytest.fixture
def topic(bench: Bench, topic_name: str) -> str:
    """A topic that nobody else uses, with one partition, in the Kafka of the run."""
    bench.create_topic(topic_name)
    return topic_name


@pytest.fixture
def own_topic(own_bench: Bench, topic_name: str) -> str:
    """The same in a Kafka of one's own."""
    own_bench.create_topic(topic_name)
    return topic_name


@pytest.fixture
def returned(bench: Bench, topic_name: str) -> str:
    """Another topic: where what went to ROS comes back."""
    bench.create_topic(name := f'{topic_name}.returned')
    return name


@pytest.fixture
def arrived(tmp_path: Path) -> Path:
    """The file of a subscriber."""
    return tmp_path / 'arrived'


@pytest.fixture
def leave(tmp_path: Path) -> Leave:
    """How far the peer of a test may go."""
    return Leave(tmp_path)


@pytest.fixture
def registry() -> Iterator[RegistryServer]:
    """A Schema Registry of one's own; what it was asked is all of the protocol."""
    with RegistryServer() as server:
        yield server
    assert server.problems == []
