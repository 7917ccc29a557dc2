"""`dead-letters`: letters that a real bridge has made are found, shown, and sent again once."""

import contextlib
import json
import re
import signal
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from confluent_kafka import Producer, TopicPartition
from confluent_kafka.admin import (  # type: ignore[attr-defined]  # public, but not in __all__
    AclOperation,
    AlterConfigOpType,
    ConfigEntry,
    ConfigResource,
    ResourceType,
)
from support.bridges.letters import HOSTILE, SMALL, done, long, route, run, written_one_by_one
from support.bridges.routes import lines, to_kafka, values
from support.bridges.words import ROS_TOPIC, wait_for_commit
from support.kafka.secured import PASSWORD, USER, Right, group_right, running, topic_right
from support.processes.harness import Bench, Process, eventually, headers
from support.ros.robots import installed, robot

from ros2_kafka_bridge.dead_letters.writer import explain, from_kafka
from ros2_kafka_bridge.endpoints import Outgoing
from ros2_kafka_bridge.errors import DecodeError
from ros2_kafka_bridge.kafka.overview import KafkaTopic, Overview
from ros2_kafka_bridge.kafka.transactions import Parcel, Send
from ros2_kafka_bridge.monitoring.letters import newest
from ros2_kafka_bridge.process.load import load_checked
from ros2_kafka_bridge.testing.local_kafka import LocalKafka

CRATE = 'acme_crates/msg/Crate'


def make_letters(bench: Bench, topic: str, end: int, **more: Any) -> None:
    """Let a bridge whose limit is too small read a topic to its end."""
    # One that the group has given up in between would write some of them again.
    config = bench.config([route(topic, SMALL, **more)], kafka=bench.patient_kafka)
    with bench.drained(config) as bridge:
        wait_for_commit(bench, topic, end, bridge)


def start(bench: Bench, *arguments: str | Path) -> Process:
    """Start a command in the background."""
    return bench._start('-m', 'ros2_kafka_bridge', 'dead-letters', *map(str, arguments))


def test_what_would_fail_again_stays_and_a_changed_format_takes_it(
    bench: Bench, topic: str
) -> None:
    cdr = b'\0\1\0\0\4\0\0\0abc\0'
    bench.produce(topic, [cdr, b'caf\xe9', None, long(1)], key=HOSTILE)
    make_letters(bench, topic, 4)
    bench.produce(f'{topic}.dead-letters', [HOSTILE], headers=[('dead_letter.error', b'\n')])
    text = bench.config([route(topic)])
    as_cdr = bench.config([route(topic) | {'format': 'cdr'}])

    listed = done(bench, 'list', text)
    assert not re.search(r'[\x00-\x09\x0b-\x1f\x7f\u202e]', listed)
    assert 'not a dead letter of a bridge' in listed
    assert len([line for line in listed.splitlines() if '[0]@' in line]) == 5
    young = ('--since', '1h', '--route', 'to_ros', '--reason', '^DecodeError: (a|n|t)')
    assert '3 dead letters\n' in done(bench, 'list', text, *young)
    assert 'no dead letters that fit' in done(bench, 'list', text, '--until', '1d')

    status, output, _ = run(bench, 'replay', text, '--all')
    assert status == 1
    assert output.count('would fail again: DecodeError: ') == 3
    assert f'1 letter replayed to {topic}; 3 left as they are; 1 not dead' in output
    status, output, _ = run(bench, 'replay', as_cdr, '--reason', 'DecodeError')
    assert (status, output.count('left: ')) == (1, 2)
    found = [record.value() for record in bench.records(topic, 6)]
    assert found[4:] == [long(1), cdr]
    assert '1 letter replayed' in done(bench, 'replay', text, '--reason', 'not UTF-8', '--force')
    assert bench.records(topic, 7)[6].value() == b'caf\xe9'


def test_a_killed_replay_and_two_at_once_write_every_letter_exactly_once(
    bench: Bench, topic: str
) -> None:
    count = 5000
    bench.produce(topic, [long(number) for number in range(count)])
    make_letters(bench, topic, count)
    config = bench.config([route(topic)])
    overview = Overview({'bootstrap.servers': bench.bootstrap_servers})

    def midway(number: int) -> Process:
        replay = begun(bench, config, overview, topic)
        replay.send(signal.Signals(number))
        return replay

    with midway(signal.SIGKILL) as killed:
        assert killed.wait() == -signal.SIGKILL, killed.output()
    assert 0 < left(bench, config) < count
    with midway(signal.SIGINT) as stopped:
        assert stopped.wait(120) == 1, stopped.output()
        assert 'stopped: ' in stopped.output()
        assert 'the same command goes on with the rest' in stopped.output()
    assert left(bench, config) > 0
    with midway(signal.SIGSTOP) as first:
        assert 'replayed' in done(bench, 'replay', config, '--all')
        first.send(signal.SIGCONT)
        assert first.wait(120) == 1, first.output()
        assert 'another has taken over' in first.output()
        assert 'the same command goes on with the rest' in first.output()
    assert left(bench, config) == 0
    found = values(bench.records(topic, 2 * count))
    assert Counter(found) == dict.fromkeys(map(long, range(count)), 2)
    assert found[count:] == found[:count]


@pytest.mark.kills_kafka
def test_a_replay_whose_broker_dies_says_so_and_the_next_one_goes_on(
    own_bench: Bench, own_kafka: LocalKafka, own_topic: str
) -> None:
    bench, count = own_bench, 3000
    bench.produce(own_topic, [long(number) for number in range(count)])
    make_letters(bench, own_topic, count)
    config = bench.config([route(own_topic)])
    overview = Overview({'bootstrap.servers': bench.bootstrap_servers})
    with begun(bench, config, overview, own_topic) as replay:
        own_kafka.kill()
        assert replay.wait(180) == 1
        assert 'the same command goes on with the rest' in replay.output()
        assert 'Traceback' not in replay.output()
    own_kafka.start()
    done(bench, 'replay', config, '--all')
    found = values(bench.records(own_topic, 2 * count))
    assert found == [*map(long, range(count))] * 2


def begun(bench: Bench, config: Path, overview: Overview, topic: str) -> Process:
    """A replay that has written two of its transactions at least."""
    end = written(overview, topic)
    replay = start(bench, 'replay', config, '--route', 'to_ros')
    eventually(lambda: written(overview, topic) > end + 500, 120, replay.output)
    return replay


def written(overview: Overview, topic: str) -> int:
    """How far a topic reaches, with what is not committed."""
    return overview.ends([KafkaTopic(topic, 1, '')])[topic, 0]


def left(bench: Bench, config: Path) -> int:
    """How many letters are not replayed."""
    [kind] = json.loads(done(bench, 'list', config, '--json'))['summary']
    return int(kind['letters']) - int(kind['replayed'])


def test_a_value_that_was_left_out_comes_from_its_first_topic_while_that_holds_it(
    bench: Bench, topic: str
) -> None:
    letters = f'{topic}.dead-letters'
    bench.create_topic(letters, max_message_bytes='1000')
    bench.produce(topic, [b'x' * 5000, b'y' * 5000], key=b'key', headers=[('a', b'b')])
    make_letters(bench, topic, 2)
    config = bench.config([route(topic)])
    assert 'left out (5000 bytes)' in done(bench, 'show', config, f'{letters}[0]@0')
    admin = bench.admin()
    [gone] = admin.delete_records([TopicPartition(topic, 0, 1)]).values()
    gone.result(60)
    status, output, _ = run(bench, 'replay', config, '--all')
    assert status == 1
    assert f'left: {letters}[0]@0: its value (5000 bytes) was left out, and' in output
    [_, replayed] = bench.records(topic, 2)
    assert (replayed.key(), replayed.value()) == (b'key', b'y' * 5000)
    assert replayed.headers() == [('a', b'b')]


def test_a_letter_that_kafka_refuses_is_left_and_the_others_go(
    bench: Bench, topic_name: str
) -> None:
    letters = f'{topic_name}.dead-letters'
    bench.create_topic(topic_name, max_message_bytes='1000')
    bench.create_topic(letters)
    bench.produce(topic_name, [b'the records of the letters'] * 3)
    admin = bench.admin()
    [gone] = admin.delete_records([TopicPartition(topic_name, 0, 3)]).values()
    gone.result(60)
    for number, value in enumerate([long(1), b'x' * 5000, long(2)]):
        origin = from_kafka('to_ros', topic_name, 0, number)
        letter = explain(Outgoing(letters, None, value, []), DecodeError('once'), origin)
        bench.produce(letters, [value], headers=letter.headers)
    config = bench.config([route(topic_name)])
    status, output, errors = run(bench, 'replay', config, '--all')
    assert (status, errors) == (1, '')
    assert f'left: {letters}[0]@1: Kafka refuses: Broker: Message size too large\n' in output
    assert f'2 letters replayed to {topic_name}; 1 left as they are\n' in output
    assert values(bench.records(topic_name, 2)) == [long(1), long(2)]
    assert left(bench, config) == 1


@pytest.mark.parametrize('behind', [0, 1, 20_000])
def test_a_refused_record_is_told_whenever_the_answer_comes_and_all_others_are_written_once(
    bench: Bench, topic_name: str, behind: int
) -> None:
    small, large = (Outgoing(topic_name, None, value, []) for value in (b'small', b'x' * 5000))
    bench.create_topic(topic_name, max_message_bytes='1000')
    properties = {'bootstrap.servers': bench.bootstrap_servers}
    # With nothing behind it, the broker counts on from before the refused record, the client from
    # behind it; with much behind it, the answer comes while the rest of its parcel is produced.
    parcels = [
        Parcel(1, [Send(small, 0)]),
        Parcel(2, [Send(large, 0), *[Send(small, 0)] * behind]),
        *[Parcel(3, [Send(small, 0)])] * bool(behind),
    ]
    [refused] = written_one_by_one(properties, topic_name, [parcels, parcels[:1]])
    assert refused.parcel.number == 2
    assert str(refused.error) == 'Kafka refuses: Broker: Message size too large'
    count = 2 + bool(behind)
    assert values(bench.records(topic_name, count)) == [b'small'] * count


def test_letters_go_straight_to_ros_once_a_subscriber_is_there(
    bench: Bench, topic: str, arrived: Path
) -> None:
    count = 500
    bench.produce(topic, [*map(long, range(count)), b'\xff'])
    make_letters(bench, topic, count + 1)
    config = bench.config([route(topic)])
    with bench.subscriber(ROS_TOPIC, arrived) as subscriber:
        subscriber.wait_for('ready', 60)
        status, output, errors = run(bench, 'replay', config, '--all', '--to', 'ros')
        assert (status, errors) == (1, '')
        assert f'{count} letters replayed to ros:{ROS_TOPIC}; 1 left as they are' in output
        eventually(lambda: len(lines(arrived)) >= count, 60)
    assert lines(arrived) == [long(number).decode() for number in range(count)]
    assert bench.end_offset(topic) == count + 1
    status, output, _ = run(bench, 'replay', config, '--all')
    assert (status, f'{count} replayed before' in output) == (1, True)


def test_letters_of_a_type_that_is_not_installed_wait_for_who_describes_it(
    bench: Bench, topic: str, arrived: Path
) -> None:
    prefix = installed(bench.place, 'acme_crates', {'Crate': 'string label\nint32 kilos\n'})
    letters, record = f'{topic}.dead-letters', b'{"label":"tea","kilos":3}'
    bench.create_topic(letters)
    bench.produce(topic, [record, b'{"label":"tea"}'])
    for number, value in enumerate([record, b'{"label":"tea"}']):
        origin = from_kafka('to_ros', topic, 0, number)
        letter = explain(Outgoing(letters, None, value, []), DecodeError('once'), origin)
        bench.produce(letters, [value], headers=letter.headers)
    to = {'ros': '/crates', 'type': CRATE, 'qos': {'durability': 'transient_local'}}
    crates = route(topic) | {'format': 'json', 'to': to}
    config = bench.config([crates])

    status, output, errors = run(bench, 'replay', config, '--all', '--to', 'ros')
    assert (status, errors) == (1, '')
    assert output.count(f'no message type {CRATE} here, and nobody there tells how it is') == 2
    assert output.count(f'schema {CRATE} --from-graph --format msg --output DIR writes them') == 2
    with robot(bench, CRATE, prefix, takes={'/crates': arrived}):
        status, output, errors = run(bench, 'replay', config, '--all', '--to', 'ros')
        assert (status, errors) == (1, '')
        assert '1 letter replayed to ros:/crates; 1 left as they are' in output
        assert 'would fail again: DecodeError: $' in output
        eventually(lambda: len(lines(arrived)) > 0, 60)
    tea = b'\0\1\0\0\4\0\0\0tea\0\3\0\0\0'
    assert lines(arrived) == [tea.hex()]
    of_folder = bench.config([crates], ros={'message_path': [str(prefix / 'src')]})
    status, output, _ = run(bench, 'replay', of_folder, '--all', '--again')
    assert (status, output.count('would fail again')) == (1, 1)
    assert f'1 letter replayed to {topic}' in output


def test_a_message_of_ros_that_kafka_refused_goes_on_to_its_topic(
    bench: Bench, topic_name: str
) -> None:
    # It takes nothing that is older than it was when it came; each record waits for some time.
    bench.create_topic(topic_name, message_timestamp_before_max_ms='0')
    slow = {'to': {'kafka': topic_name, 'properties': {'linger.ms': 50}}}
    config = bench.config([to_kafka(ROS_TOPIC, topic_name) | slow])
    with bench.drained(config), bench.publisher(ROS_TOPIC, '--count', '2'):
        made = bench.records(f'{topic_name}.dead-letters', 2)
    change(bench, topic_name, 'message.timestamp.before.max.ms', '3600000')
    eventually(lambda: takes(bench, topic_name), 60)
    assert '2 letters replayed' in done(bench, 'replay', config, '--all')
    replayed = bench.records(topic_name, 3)[1:]
    assert values(replayed) == values(made)
    assert [record.key() for record in replayed] == [ROS_TOPIC.encode()] * 2
    assert [headers(record)['ros.seq'] for record in replayed] == ['1', '2']
    assert not [name for name in headers(replayed[0]) if name.startswith('dead_letter')]


def takes(bench: Bench, topic: str) -> bool:
    """Whether a topic takes a record now."""
    with contextlib.suppress(AssertionError):  # the broker refuses until it has heard of a change
        bench.produce(topic, [b'a try'])
    return bench.reaches(topic, 1)


def change(bench: Bench, topic: str, name: str, value: str) -> None:
    """Change a property of a topic."""
    entry = ConfigEntry(name, value, incremental_operation=AlterConfigOpType.SET)
    resource = ConfigResource(ResourceType.TOPIC, topic, incremental_configs=[entry])
    admin = bench.admin()
    admin.incremental_alter_configs([resource])[resource].result(60)


def test_missing_topics_hold_no_letters(bench: Bench, topic_name: str) -> None:
    config = bench.config([route(topic_name)])
    none = f'no dead letters ({topic_name}.dead-letters: not there)'
    assert none in done(bench, 'list', config)
    assert none in done(bench, 'replay', config, '--all')
    status, _, errors = run(bench, 'show', config, f'{topic_name}.dead-letters[0]@7')
    assert (status, 'no dead letters at offset 7' in errors) == (2, True)


def test_letters_behind_a_transaction_that_hangs_are_not_said_to_be_none(
    bench: Bench, topic_name: str
) -> None:
    letters = f'{topic_name}.dead-letters'
    bench.create_topic(letters)
    bench.produce(letters, [b'before'])
    config = bench.config([route(topic_name)])
    properties = {'bootstrap.servers': bench.bootstrap_servers, 'transactional.id': letters}
    hung = Producer(properties)
    hung.init_transactions(60)
    hung.begin_transaction()
    for _ in range(20):
        hung.produce(letters, b'behind')
    hung.flush(60)
    try:
        listed = done(bench, 'list', config)
        young = json.loads(done(bench, 'list', config, '--since', '2099-01-01', '--json'))
        page = newest(load_checked(config), letters)
    finally:
        hung.abort_transaction(60)
    assert '1 dead letter\n' in listed
    assert f'{letters}[0] is not seen from offset 1 on' in listed
    assert young['unseen'] == [{'topic': letters, 'partition': 0, 'offset': 1}]
    assert (page['seen'], len(page['unseen'])) == (1, 1)
    assert json.loads(done(bench, 'list', config, '--json'))['unseen'] == []


def test_the_rights_of_the_docs_are_enough_and_each_that_is_missing_is_named(
    tmp_path: Path, topic_name: str, ros_domain: int
) -> None:
    letters = f'{topic_name}.dead-letters'
    with running(tmp_path) as secured:
        bench = Bench(tmp_path, secured.node.bootstrap_servers, ros_domain)
        bench.create_topic(topic_name)
        bench.produce(topic_name, [long(1)])
        make_letters(bench, topic_name, 1)
        kafka = secured.properties('SCRAM', tmp_path)
        config = bench.config([route(topic_name)], kafka=kafka, name=USER)
        rights = [topic_right(letters, 'READ'), group_right(f'{USER}.', prefixed=True)]
        for command, missing, right in (
            ('list', f'topic {letters}: ', topic_right(letters, 'READ')),
            ('replay', 'WRITE and DESCRIBE on the transactional id', writes(f'{letters}.replay')),
            ('replay', f'the topic {topic_name} is not there', topic_right(topic_name, 'WRITE')),
            ('replay', 'give this user WRITE on the topic', topic_right(letters, 'WRITE')),
        ):
            arguments = ('--all',) if command == 'replay' else ()
            status, output, errors = run(bench, command, config, *arguments)
            assert status == 1
            assert missing in output + errors
            assert PASSWORD not in output + errors
            secured.allow(USER, [*rights, right])
        assert '1 letter replayed' in done(bench, 'replay', config, '--all')
        assert '0 letters replayed; 1 replayed before' in done(bench, 'replay', config, '--all')


def writes(transactional_id: str) -> Right:
    """WRITE, which includes DESCRIBE."""
    return Right(ResourceType.TRANSACTIONAL_ID, transactional_id, AclOperation.WRITE)
