"""`check --connect` as a user meets it: what it prints of a broker and a graph."""

import contextlib
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from confluent_kafka import Consumer, TopicPartition
from support.bridges.routes import lines, to_kafka, to_ros
from support.patience import patient
from support.processes.harness import Bench, eventually
from support.processes.lifetimes import ended
from support.processes.terminal import on_terminal, without_colours
from support.ros.robots import installed, robot

from ros2_kafka_bridge.kafka.topic_id import TopicId, TopicIds
from ros2_kafka_bridge.testing.local_kafka import free_port

Unique = Callable[[str], str]
SECRET = 'open-sesame'  # noqa: S105 (of the test)
SASL = {
    'security.protocol': 'SASL_PLAINTEXT',
    'sasl.mechanisms': 'PLAIN',
    'sasl.username': 'robot',
    'sasl.password': SECRET,
}
OFFERED = 'durability: volatile is offered, transient_local is asked for'
CURE = r'set to\.qos: \{durability: transient_local\}'


def test_all_is_well_at_a_real_broker_and_graph(bench: Bench, topic_name: str) -> None:
    bench.create_topic(topic_name, partitions=3)
    bench.create_topic(f'{topic_name}.dead-letters')
    bench.produce(topic_name, [b'a', b'b', b'c'])
    file = bench.config([to_ros(topic_name, '/orders')])
    with bench.subscriber('/orders', bench.place / 'received') as subscriber:
        subscriber.wait_for('ready')
        status, out, err = bench.command('check', str(file), '--connect')
    assert (status, err) == (0, '')
    assert re.search(r'  ok   1 broker of cluster \S+ answers', out)
    domain = r'domain \d+ \(ROS_DOMAIN_ID\)'
    assert re.search(rf'  ok   rclpy of \S+, rmw_fastrtps_cpp, {domain}', out)
    assert f'  ok   topic {topic_name} has 3 partitions' in out
    assert f'  ok   topic {topic_name}.dead-letters has 1 partition\n' in out
    none = f'group {bench.group} has no committed offsets (it is new, they have expired, or went'
    start = 'start is earliest, all that the topic holds (3 records)'
    assert f'  ok   {none} with a topic that was deleted): {start}' in out
    assert '  ok   1 subscriber of /orders matches' in out
    assert 'if one is, set max_rate' in out
    assert 'BAD' not in out
    assert out.splitlines()[-1] == '1 route would run'
    assert bench.committed(bench.group, topic_name) < 0, 'nothing is changed'


def test_each_thing_that_does_not_fit_is_a_line_with_its_cure(
    bench: Bench, unique: Unique
) -> None:
    there, missing = unique('there'), unique('missing')
    bench.create_topic(there)
    routes = [
        to_ros(there, '/latched', name='latched'),
        to_ros(there, '/later', name='later', **{'from': {'kafka': there, 'group': 'later'}}),
        to_ros(missing, '/lost', name='lost'),
        to_kafka('/sensor', there, name='sensor'),
        to_kafka(
            '/sensor',
            there,
            name='keyed',
            to={'kafka': there, 'key': '{message.dat}'},
            **{'from': {'ros': '/sensor'}},  # the graph tells the type, and not the file
        ),
        to_kafka('/nobody', missing, name='nobody'),
    ]
    file = bench.config(routes)
    with (
        bench.subscriber(
            '/latched', bench.place / 'received', '--durability', 'transient_local'
        ) as subscriber,
        bench.publisher(
            '/sensor', '--count', '0', '--reliability', 'best_effort', '--readers', '0'
        ) as publisher,
    ):
        subscriber.wait_for('ready')
        publisher.wait_for('published')
        status, out, err = bench.command('check', str(file), '--connect')
    assert (status, err) == (1, '')
    assert re.search(rf'  BAD  /subscriber_\d+ does not match: {OFFERED}; {CURE}', out)
    assert '  note 0 of 1 subscriber of /latched: the route waits for them' in out
    assert not re.search(r'\n  (ok|note) .*\n  BAD ', out), 'they stand first in their section'
    offer = r'/publisher_\d+ publishes best_effort, volatile'
    assert re.search(rf'  note {offer}: what the network loses is lost before the bridge', out)
    assert '  BAD  std_msgs/msg/String has no number or text at dat (did you mean data?)' in out
    assert '  note nobody publishes /nobody' in out
    assert re.search(rf'  BAD  topic {missing} is not there \(.*\); create it', out)
    assert f'  note topic {missing} is not there: the broker creates it' in out
    assert f'dead-letter topic {there}.dead-letters is not there: it is created at the' in out
    last = out.splitlines()[-1]
    waits = '1 would wait (later: for subscribers of /later)'
    assert last.startswith(f'2 routes would run; {waits}; 3 cannot run as it is (latched: ')
    found = bench.admin().list_topics(timeout=patient(10)).topics
    assert missing not in found, 'nothing is changed'


def test_it_says_how_much_a_group_has_to_deliver(bench: Bench, topic: str) -> None:
    bench.produce(topic, [b'%d' % number for number in range(10)])
    file = bench.config([to_ros(topic, '/orders')])
    with bench.subscriber('/orders', bench.place / 'received') as subscriber:
        subscriber.wait_for('ready')
        with bench.drained(file):
            eventually(lambda: len(lines(bench.place / 'received')) == 10, 60)
        bench.produce(topic, [b'10', b'11'])
        ids = TopicIds({'bootstrap.servers': bench.bootstrap_servers})
        now = ids.answer(ids.ask(topic), 30.0)
        assert now is not None
        others = [
            of_group(bench, topic, 'gone', TopicId(now.cluster_id, 'gone')),
            of_group(bench, topic, 'elsewhere', TopicId('elsewhere', 'gone')),
        ]
        file = bench.config([to_ros(topic, '/orders'), *others])
        _, out, _ = bench.command('check', str(file), '--connect')
    assert f'group {bench.group} goes on at its committed offsets, 2 records to deliver' in out
    offsets = rf'  note the offsets of group {bench.name}\.\w+ at {topic}\[0\] are of'
    all_of_it = 'the bridge reads all that is there now, 12 records to deliver'
    assert re.search(f'{offsets} a topic of this name that is gone: {all_of_it}', out)
    here = f'and this is cluster {now.cluster_id}: the bridge goes on at them, 2 records'
    assert re.search(f'{offsets} cluster elsewhere, {here} to deliver; where .* --reset', out)


def of_group(bench: Bench, topic: str, name: str, of: TopicId) -> dict[str, Any]:
    """A route to ROS whose group has read ten records of a topic of this name."""
    group = f'{bench.name}.{name}'
    places = [TopicPartition(topic, 0, 10, of.metadata)]
    servers = {'bootstrap.servers': bench.bootstrap_servers}
    with contextlib.closing(Consumer({**servers, 'group.id': group})) as client:
        client.commit(offsets=places, asynchronous=False)
    source = {'kafka': topic, 'group': group}
    return to_ros(topic, '/orders', name=name, **{'from': source})


def test_without_a_broker_it_says_so_and_still_looks_at_ros(bench: Bench) -> None:
    bench.bootstrap_servers = f'127.0.0.1:{free_port()}'
    large = to_kafka('/large', 'large', name='large', max_message_bytes=50_000_000)
    routes = [to_ros('orders', '/orders'), to_kafka('/small', 'small', name='small'), large]
    file = bench.config(routes, kafka={'bootstrap.servers': bench.bootstrap_servers, **SASL})
    status, out, err = bench.command('check', str(file), '--connect')
    assert (status, err) == (1, '')
    lost = 'messages may have 50,000,000 bytes (max_message_bytes), and a UDP socket of DDS holds'
    assert out.count('  note messages may have ') == out.count(lost) == 1
    asked = f'is bootstrap.servers ({bench.bootstrap_servers}) right, does the broker run?'
    assert re.search(rf'  BAD  the broker does not answer.*{re.escape(asked)}', out)
    assert '  note 0 of 1 subscriber of /orders: the route waits for them' in out
    assert out.splitlines()[-1].startswith('No route can run: the broker does not answer')
    assert SECRET not in out


def test_a_type_is_told_with_the_node_that_describes_it_and_one_without_is_wrong(
    bench: Bench, unique: Unique, tmp_path: Path
) -> None:
    prefix = installed(tmp_path, 'acme_tf', {'Moved': 'string text\n', 'Lied': 'int32 x\n'})
    there = unique('there')
    bench.create_topic(there)
    # The graph tells the type of the first alone.
    learned = {'name': 'moved', 'format': 'json', 'from': {'ros': '/moved'}}
    routes = [
        {**learned, 'to': {'kafka': there, 'key': '{message.text}'}},
        to_kafka('/lied', there, name='lied', format='json')
        | {'from': {'ros': '/lied', 'type': 'acme_tf/msg/Lied'}},
        to_ros(there, '/later', name='later', format='json')
        | {'to': {'ros': '/later', 'type': 'acme_tf/msg/Moved'}},
    ]
    with (
        robot(bench, 'acme_tf/msg/Moved', prefix, '--name', 'mover', publishes={'/moved': []}),
        robot(
            bench, 'acme_tf/msg/Lied', prefix, '--name', 'liar', '--describes', 'lies',
            publishes={'/lied': []},
        ),
    ):  # fmt: skip
        status, out, err = bench.command('check', str(bench.config(routes)), '--connect')
    assert (status, err) == (1, '')
    assert '  ok   acme_tf/msg/Moved is described by the node /mover\n' in out
    assert '  ok   json carries acme_tf/msg/Moved\n' in out
    assert '  ok   {message.text}: acme_tf/msg/Moved has it\n' in out
    lie = 'no message type acme_tf/msg/Lied here, and nobody describes it: /liar describes another'
    assert f'  BAD  {lie}' in out
    assert 'put its .msg files into a folder of ros.message_path' in out
    waits = 'waits for a node that uses /later, to ask it for the type'
    assert f'  note the route {waits}: no message type acme_tf/msg/Moved here' in out
    assert out.splitlines()[-1].startswith(
        '1 route would run; 1 would wait (later: for a node that uses /later, for subscribers of '
        f'/later); 1 cannot run as it is (lied: {lie}'
    )


# A terminal


def test_a_terminal_shows_a_table_that_fits_it(bench: Bench, topic: str) -> None:
    file = bench.config([to_ros(topic, '/latched', name='latched')])
    with bench.subscriber(
        '/latched', bench.place / 'received', '--durability', 'transient_local'
    ) as subscriber:
        subscriber.wait_for('ready')
        status, shown = on_terminal('check', str(file), '--connect', columns=80)
    assert status == 1
    assert re.search(r'\x1b\[[0-9;]*32mok', shown), 'green'
    assert re.search(r'\x1b\[[0-9;]*31mBAD', shown), 'red'
    found = without_colours(shown)
    text = ' '.join(' '.join(found).split())
    assert re.search(rf'BAD readers /subscriber_\d+ does not match: {OFFERED}', text)
    assert re.search(f'-> {CURE}', text)
    assert max(map(len, found[2:])) <= 80
    assert '…' not in shown


def test_ctrl_c_ends_it_without_a_traceback(bench: Bench, topic_name: str) -> None:
    log = bench.place / 'out'
    with socket.create_server(('127.0.0.1', 0)) as silent, log.open('wb') as output:
        silent.settimeout(patient(60))
        broker = {'bootstrap.servers': f'127.0.0.1:{silent.getsockname()[1]}'}
        file = bench.config([to_ros(topic_name, '/orders')], kafka=broker)
        command = [sys.executable, '-m', 'ros2_kafka_bridge', 'check', str(file), '--connect']
        program = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT
        )
        with ended(program) as process:
            connection, _ = silent.accept()  # it asks, and hears nothing
            process.send_signal(signal.SIGINT)
            assert process.wait(patient(20)) == 130
            connection.close()
    assert 'Traceback' not in log.read_text()
