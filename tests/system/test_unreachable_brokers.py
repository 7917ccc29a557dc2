"""A broker that names an address which nobody can reach (`advertised.listeners`)."""

import contextlib
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Thread

import pytest
from support.bridges.routes import to_kafka, to_ros
from support.monitoring.scrapes import watched
from support.processes.harness import Bench, eventually

from ros2_kafka_bridge.testing.local_kafka import HOST, LocalKafka, free_port

NAMES = ('CONTROLLER', 'PLAINTEXT', 'WRONG')


@pytest.fixture(params=['nosuch.invalid:9092', 'dead'], ids=['name', 'port'])
def wrong(request: pytest.FixtureRequest) -> str:
    """What the broker calls itself."""
    return f'{HOST}:{free_port()}' if request.param == 'dead' else str(request.param)


@pytest.fixture
def misled(wrong: str, tmp_path: Path, ros_domain: int) -> Iterator[tuple[Bench, Bench]]:
    """A bench on a listener whose address is right, and one where it is not."""
    port, own = free_port(), free_port()
    listeners = {
        'listeners': f'WRONG://{HOST}:{port}',
        'advertised.listeners': f'PLAINTEXT://{HOST}:{own},WRONG://{wrong}',
        'listener.security.protocol.map': ','.join(f'{name}:PLAINTEXT' for name in NAMES),
    }
    with (
        LocalKafka(port=own, properties=listeners) as node,
        contextlib.closing(Bench(tmp_path, node.bootstrap_servers, ros_domain)) as right,
        contextlib.closing(Bench(tmp_path, f'{HOST}:{port}', ros_domain)) as misled,
    ):
        yield right, misled


def test_a_broker_that_names_a_wrong_address_is_away_and_named(
    misled: tuple[Bench, Bench], wrong: str, unique: Callable[[str], str]
) -> None:
    right, bench = misled
    topic = unique('orders')
    right.create_topic(topic)
    routes = [to_ros(topic, '/orders'), to_kafka('/returned', topic)]
    status, out, _ = bench.command('check', '--connect', str(bench.config(routes)))
    said = ' '.join(out.split())
    assert status == 1
    # The second, where the client was at that address before it had asked its question.
    assert (
        f'BAD the cluster names {wrong} as the address of broker 1, and nobody answers' in said
        or f'and named {wrong} as the address of a broker' in said
    )
    assert 'mend its advertised.listeners' in said
    assert 'is not there' not in said, 'nothing is known of the topic'
    bridge = watched(bench, routes)
    with bridge.process as process:
        bridge.becomes('livez', 200)
        named = f'and named {wrong} as the address of a broker'
        for name in ('to_ros', 'to_kafka'):
            eventually(lambda n=name: named in bridge.route(n)['reason'], 60, process.output)  # type: ignore[misc]
        time.sleep(15)  # it came back 21 times in 42 s
        for name in ('to_ros', 'to_kafka'):
            assert named in bridge.route(name)['reason']
            assert bridge.route(name)['state'] == 'starting', 'it has never been there'
        assert bridge.scrape().of('kafka_up', route='to_ros') == 0
    lines = process.output().splitlines()
    assert not [line for line in lines if line.endswith('Kafka is back')]
    assert len([line for line in lines if 'Kafka is away' in line and 'WARNING' in line]) == 2


def test_a_server_of_the_web_is_no_broker_of_which_records_are_to_be_skipped(
    tmp_path: Path, ros_domain: int, unique: Callable[[str], str]
) -> None:
    with socket.create_server((HOST, 0)) as web:
        Thread(target=_refuse, args=(web,), daemon=True).start()
        at = f'{HOST}:{web.getsockname()[1]}'
        with contextlib.closing(Bench(tmp_path, at, ros_domain)) as bench:
            file = str(bench.config([to_ros(unique('orders'), '/orders')]))
            status, out, _ = bench.command('check', '--connect', file)
    said = ' '.join(out.split())
    assert status == 1
    assert 'what answers there may be no broker' in said
    assert 'set the offset of the group' not in said


def _refuse(web: socket.socket) -> None:
    with contextlib.suppress(OSError):
        while True:
            with web.accept()[0] as visitor:
                visitor.recv(1000)
                visitor.sendall(b'HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\n\r\n')
