"""A real Kafka on this machine: it keeps its records, its place and its promises."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from confluent_kafka import Consumer, Producer, TopicPartition
from support.kafka.shared import SharedKafka
from support.patience import patient
from support.processes.lifetimes import ended
from support.processes.terminal import finished

from ros2_kafka_bridge.errors import ConfigError, TransportError
from ros2_kafka_bridge.testing.kafka_jars import archive_flags, find_jars, install_jars, java
from ros2_kafka_bridge.testing.kafka_node import is_free, new_id
from ros2_kafka_bridge.testing.local_kafka import LocalKafka, free_port, make_archive

PROGRAM = [sys.executable, '-m', 'ros2_kafka_bridge.testing.local_kafka']

ABANDON = """
import os, pathlib, sys
from ros2_kafka_bridge.testing.local_kafka import LocalKafka
node = LocalKafka(pathlib.Path(sys.argv[1]))
node.start()
print(node.pid, flush=True)
os.kill(os.getpid(), 9)
"""


@pytest.mark.parametrize(
    'end',
    [LocalKafka.stop, pytest.param(LocalKafka.kill, marks=pytest.mark.kills_kafka)],
)
def test_a_record_outlives_a_restart(
    own_kafka: LocalKafka, topic_name: str, end: Callable[[LocalKafka], None]
) -> None:
    address = own_kafka.bootstrap_servers
    produce(address, topic_name, b'kept')
    end(own_kafka)
    assert not own_kafka.is_running
    own_kafka.start()
    assert own_kafka.bootstrap_servers == address
    assert consume(address, topic_name) == b'kept'


def test_a_directory_keeps_the_records_for_the_next_node(tmp_path: Path, topic_name: str) -> None:
    with LocalKafka(tmp_path) as node:
        produce(node.bootstrap_servers, topic_name, b'kept')
    with LocalKafka(tmp_path) as node:
        assert consume(node.bootstrap_servers, topic_name) == b'kept'


def test_a_node_that_stands_still_for_3_s_stays_the_leader(topic_name: str) -> None:
    """As on a busy machine: who is given up meanwhile sends its clients NOT_LEADER."""
    with LocalKafka() as node:
        produce(node.bootstrap_servers, topic_name, b'before')
        for _ in range(4):  # once it may just say in time that it lives
            os.kill(node.pid, signal.SIGSTOP)
            time.sleep(3)
            os.kill(node.pid, signal.SIGCONT)
            produce(node.bootstrap_servers, topic_name, b'after')
        with Consumer({'bootstrap.servers': node.bootstrap_servers, 'group.id': 'test'}) as reader:
            reader.assign([TopicPartition(topic_name, 0, 0)])
            found = reader.consume(5, timeout=20)
        assert [message.leader_epoch() for message in found] == [0] * 5


def test_two_nodes_at_once_keep_apart(
    kafka: SharedKafka, own_kafka: LocalKafka, topic_name: str
) -> None:
    produce(kafka.bootstrap_servers, topic_name, b'one')
    produce(own_kafka.bootstrap_servers, topic_name, b'other')
    assert consume(kafka.bootstrap_servers, topic_name) == b'one'
    assert consume(own_kafka.bootstrap_servers, topic_name) == b'other'


def test_a_node_answers_on_its_own_address_alone(kafka: SharedKafka) -> None:
    socket.create_connection(('127.0.0.1', kafka.port)).close()
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(('127.0.0.2', kafka.port))


def test_a_busy_port_is_one_clear_sentence() -> None:
    with socket.create_server(('127.0.0.1', 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(ConfigError, match=f'port {port} of 127.0.0.1 is in use'):
            LocalKafka(port=port).start()


def test_a_node_that_cannot_start_names_the_reason_and_the_log(tmp_path: Path) -> None:
    node = LocalKafka(tmp_path, properties={'num.partitions': 'many'})
    with pytest.raises(TransportError, match=r'kafka\.log: .* many .* num\.partitions'):
        node.start()


def test_a_property_of_the_caller_wins(topic_name: str) -> None:
    with LocalKafka(properties={'num.partitions': '3'}) as node:
        produce(node.bootstrap_servers, topic_name, b'first')
        with Producer({'bootstrap.servers': node.bootstrap_servers}) as client:
            topics = client.list_topics(topic_name, timeout=10).topics
        assert len(topics[topic_name].partitions) == 3


def test_a_listener_of_the_caller_is_added(topic_name: str) -> None:
    port = free_port()
    more = {
        'listeners': f'INSIDE://127.0.0.1:{port}',
        'listener.security.protocol.map': (
            'CONTROLLER:PLAINTEXT,PLAINTEXT:PLAINTEXT,INSIDE:PLAINTEXT'
        ),
    }
    with LocalKafka(properties=more) as node:
        produce(f'127.0.0.1:{port}', topic_name, b'inside')
        assert consume(node.bootstrap_servers, topic_name) == b'inside'


def test_nothing_is_left_of_a_node_without_a_directory() -> None:
    with LocalKafka() as node:
        directory = node.directory
    assert not node.is_running
    assert not directory.exists()


def test_a_node_ends_with_the_process_that_was_killed(tmp_path: Path) -> None:
    command = [sys.executable, '-c', ABANDON, str(tmp_path)]
    run = subprocess.run(command, stdout=subprocess.PIPE, check=False, timeout=patient(60))
    assert run.returncode == -signal.SIGKILL
    wait_until_gone(int(run.stdout))


@pytest.mark.parametrize('stop_signal', [signal.SIGINT, signal.SIGTERM])
def test_the_program_runs_a_node_until_it_is_told_to_stop(
    stop_signal: signal.Signals, topic_name: str
) -> None:
    port = free_port()
    command = [*PROGRAM, '--port', str(port)]
    with ended(subprocess.Popen(command, stdout=subprocess.PIPE)) as program:
        assert program.stdout is not None
        assert f'127.0.0.1:{port}'.encode() in program.stdout.readline()
        produce(f'127.0.0.1:{port}', topic_name, b'first')
        program.send_signal(stop_signal)
        assert program.wait(patient(20)) == 0
    assert is_free(port)


def test_the_program_ends_with_status_2_where_the_port_is_busy(kafka: SharedKafka) -> None:
    run = finished([*PROGRAM, '--port', str(kafka.port)])
    assert run.returncode == 2
    assert run.stderr.startswith(f'port {kafka.port} of 127.0.0.1 is in use')
    assert run.stderr.count('\n') == 1


def test_jars_that_are_there_are_not_fetched_again(monkeypatch: pytest.MonkeyPatch) -> None:
    jars = install_jars()
    monkeypatch.setenv('PATH', '')
    assert install_jars() == find_jars() == jars


def test_java_takes_the_classes_that_were_kept_for_these_jars(tmp_path: Path) -> None:
    jars = install_jars()
    if not archive_flags(jars):
        make_archive(jars)
    strict = [*archive_flags(jars), '-Xshare:on', '-Xlog:class+load:file=loaded.txt']
    command = [java(), *strict, '-cp', f'{jars}/*', 'kafka.Kafka', '--version']
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    kafkas = [
        line for line in (tmp_path / 'loaded.txt').read_text().splitlines() if 'kafka' in line
    ]
    assert any('shared objects file (top)' in line for line in kafkas)


def test_missing_tools_are_all_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv('PATH', '')
    monkeypatch.delenv('JAVA_HOME', raising=False)
    with pytest.raises(ConfigError, match=r'no Java here .*17 or newer\n.*no Maven here'):
        install_jars(tmp_path)


def test_no_cluster_id_looks_like_an_option() -> None:
    assert not any(new_id().startswith('-') for _ in range(1_000))


def produce(bootstrap_servers: str, topic: str, value: bytes) -> None:
    with Producer({'bootstrap.servers': bootstrap_servers, 'acks': 'all'}) as producer:
        producer.produce(topic, value, partition=0)
        assert producer.flush(20) == 0


def consume(bootstrap_servers: str, topic: str) -> bytes | None:
    with Consumer({'bootstrap.servers': bootstrap_servers, 'group.id': 'test'}) as consumer:
        consumer.assign([TopicPartition(topic, 0, 0)])
        message = consumer.poll(20)
        assert message is not None
        assert message.error() is None
        return message.value()


def wait_until_gone(pid: int) -> None:
    deadline = time.monotonic() + 10
    while Path(f'/proc/{pid}').exists():
        assert time.monotonic() < deadline, f'process {pid} lives on'
        time.sleep(0.01)
