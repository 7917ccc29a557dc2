"""What tests share: names and ROS domains of their own, and a real Kafka."""

import fcntl
import itertools
import os
import tempfile
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import pytest
from harness import Bench

from ros2_kafka_bridge.testing.local_kafka import LocalKafka

# The ports of the other ids lie where Linux gives ports to clients.
ROS_DOMAINS: Final = (*range(1, 102), *range(215, 233))


@pytest.fixture(autouse=True, scope='session')
def _ros_stays_on_this_machine() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        yield


@pytest.fixture(scope='session')
def kafka() -> Iterator[LocalKafka]:
    """One real Kafka for all tests that leave it running."""
    with LocalKafka() as node:
        yield node


@pytest.fixture
def own_kafka() -> Iterator[LocalKafka]:
    """A real Kafka for one test, which may stop, kill and start it."""
    with LocalKafka() as node:
        yield node


@pytest.fixture
def unique() -> Callable[[str], str]:
    """Makes names that nobody else uses: `unique('orders')` is `orders-1f0c2a9e`."""
    return lambda stem: f'{stem}-{uuid.uuid4().hex[:8]}'


@pytest.fixture
def topic_name(unique: Callable[[str], str]) -> str:
    """A Kafka topic that nobody else uses."""
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
def bench(tmp_path: Path, kafka: LocalKafka, ros_domain: int) -> Bench:
    """The session's Kafka, a ROS domain of one's own, and a place for files."""
    return Bench(tmp_path, kafka.bootstrap_servers, ros_domain)


@pytest.fixture
def own_bench(tmp_path: Path, own_kafka: LocalKafka, ros_domain: int) -> Bench:
    """The same with a Kafka of one's own, to be stopped and started."""
    return Bench(tmp_path, own_kafka.bootstrap_servers, ros_domain)
