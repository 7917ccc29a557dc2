"""Types that are not installed where the bridge runs: nodes describe them, or folders do.

The guarantees are those of docs: 6b what others write proves nothing.
"""

import json
import signal
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from support.bridges.reloads import Reloaded
from support.bridges.routes import lines, values
from support.processes.harness import Bench, Process, eventually, headers
from support.ros.robots import installed, random_cdr, robot

from ros2_kafka_bridge.formats.cdr import make_exact
from ros2_kafka_bridge.message_types import load_layout

Unique = Callable[[str], str]

MOVED = 'acme_tf/msg/Moved'
MESSAGES = {
    'Moved': """\
uint8 CARRIED=1
string robot
Stamped[] transforms
uint8[<=4] flags
string<=5 unit
wstring note
bool[2] ends
""",
    'Stamped': 'std_msgs/Header header\nstring child_frame_id\nfloat64[3] moved [1.5, -2, 0]\n',
    'Lied': 'int32 x\nstring text\n',
    'Off': 'int32 x\nint32 y\n',
    'Never': 'int64 x\n',
    'Both': 'uint8 x\n',
    'Huge': 'uint8 x\nfloat64[4000000000] room\n',
    'Fine': 'string text\n',
}
LATCHED = {'durability': 'transient_local'}
FORMATS = ('cdr', 'json', 'avro', 'protobuf')
SCHEMAS = ('avro', 'protobuf')
CURE = 'put its .msg files into a folder of ros.message_path, or install its package'


@pytest.fixture(scope='module')
def robots(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What is installed on the robots alone."""
    return installed(tmp_path_factory.mktemp('new'), 'acme_tf', MESSAGES)


@pytest.fixture(scope='module')
def old_robots(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same package before somebody has added a field in front."""
    older = MESSAGES | {'Fine': 'int32 number\nstring text\n', 'Both': 'uint16 x\n'}
    return installed(tmp_path_factory.mktemp('old'), 'acme_tf', older)


def from_robot(ros: str, kafka: str, form: str = 'cdr', **sink: Any) -> dict[str, Any]:
    """A route ROS -> Kafka that learns its type."""
    return {
        'name': ros.strip('/'),
        'from': {'ros': ros},
        'to': {'kafka': kafka, **sink},
        **in_format(form),
    }


def in_format(name: str) -> dict[str, Any]:
    """The format of a route, without a Schema Registry."""
    return {'format': name} | ({'schema': {'registry': False}} if name in SCHEMAS else {})


def to_robot(kafka: str, ros: str, message_type: str, form: str) -> dict[str, Any]:
    """A route Kafka -> ROS of a type."""
    return {
        'name': ros.strip('/'),
        'from': {'kafka': kafka, 'start': 'earliest'},
        'to': {'ros': ros, 'type': message_type, 'qos': LATCHED},
        **in_format(form),
    }


def assert_taken(
    file: Path, sent: Sequence[bytes], message_type: str, folder: Path, bridge: Process
) -> None:
    """A robot has taken these messages, byte for byte but for padding behind them."""
    exact = make_exact(load_layout(message_type, [folder]))
    eventually(lambda: len(lines(file)) >= len(sent), 60, bridge.output)
    assert [exact(bytes.fromhex(line)) for line in lines(file)] == list(sent)


def test_a_type_goes_there_and_back_in_every_format_that_a_node_alone_describes(
    bench: Bench, unique: Unique, robots: Path
) -> None:
    topics = {form: unique(form) for form in FORMATS}
    bench.create_topic(*topics.values())
    sent = random_cdr(MOVED, robots / 'src', 50)
    takes = {f'/back_{form}': bench.place / form for form in FORMATS}
    there = [
        from_robot('/moved', topic, form, key='{message.robot}') | {'name': f'there_{form}'}
        for form, topic in topics.items()
    ]
    back = [to_robot(topic, f'/back_{form}', MOVED, form) for form, topic in topics.items()]
    with (
        robot(bench, MOVED, robots, publishes={'/moved': sent}, takes=takes),
        bench.drained(bench.config([*there, *back])) as bridge,
    ):
        for file in takes.values():
            assert_taken(file, sent, MOVED, robots / 'src', bridge)
        records = bench.records(topics['cdr'], len(sent))
    assert values(records) == sent
    names = {bytes(record.key() or b'').decode() for record in records}
    assert len(names) > len(sent) / 2, 'each has its own'
    assert {headers(record)['ros.type'] for record in records} == {MOVED}
    assert bridge.output().count('acme_tf/msg/Moved is described by the node /robot_') == 8


def test_a_type_goes_both_ways_that_a_folder_alone_describes(
    bench: Bench, unique: Unique, robots: Path
) -> None:
    topic, took = unique('moved'), bench.place / 'took'
    bench.create_topic(topic)
    sent = random_cdr(MOVED, robots / 'src', 5)
    routes = [from_robot('/moved', topic, 'json'), to_robot(topic, '/back', MOVED, 'json')]
    ends: dict[str, Any] = {'publishes': {'/moved': sent}, 'takes': {'/back': took}}
    config = bench.config(routes, ros={'message_path': [str(robots / 'src')]})
    with (
        robot(bench, MOVED, robots, '--describes', 'not', **ends),
        bench.drained(config) as bridge,
    ):
        assert_taken(took, sent, MOVED, robots / 'src', bridge)


def test_a_node_that_lies_or_is_silent_holds_up_its_own_route_until_it_is_cured_guarantee_6b(
    bench: Bench, unique: Unique, robots: Path
) -> None:
    names = ('lied', 'off', 'never', 'huge', 'both', 'fine')
    topics = {name: unique(name) for name in names}
    sent = {
        name: random_cdr(kind_of(name), robots / 'src', 20) for name in names if name != 'huge'
    }
    routes = [from_robot(f'/{name}', topics[name]) for name in names]
    describes = {'lied': 'lies', 'off': 'not', 'never': 'never'}
    with ExitStack() as stack:

        def start(name: str, describes: str = 'rightly', node: str = '') -> None:
            options = ('--describes', describes, '--name', node or f'robot_{name}')
            publishes = {f'/{name}': [] if node else sent.get(name, [])}
            stack.enter_context(robot(bench, kind_of(name), robots, *options, publishes=publishes))

        for name in names:
            start(name, describes.get(name, 'rightly'))
        for liar in ('liar', 'robot_both'):  # one even with the name of the honest one
            start('both', 'lies', liar)
        config = bench.config(routes)
        bridge = stack.enter_context(bench.bridge(config))
        for name in ('fine', 'both'):
            assert values(bench.records(topics[name], 20)) == sent[name]
        failed = '{0}: failed: no message type {1} here, and nobody describes it: /robot_{0} {2}'
        for name, why in (
            ('lied', 'describes another one: RIHS01_'),
            ('huge', 'describes a message of 32,000,000,001 bytes or more'),
        ):
            bridge.wait_for(failed.format(name, kind_of(name), why))
        start('lied', node='honest')
        assert values(bench.records(topics['lied'], 20)) == sent['lied']
        for name in ('off', 'never'):
            bridge.wait_for(failed.format(name, kind_of(name), 'has not answered (it may be off'))
        assert bridge.output().count(CURE) >= 4
        Reloaded(bench, bridge, config).to(routes, ros={'message_path': [str(robots / 'src')]})
        for name in ('off', 'never'):
            assert values(bench.records(topics[name], 20)) == sent[name]
        assert bridge.end() == 0


def kind_of(name: str) -> str:
    return f'acme_tf/msg/{name.capitalize()}'


def test_two_definitions_of_one_name_are_told_apart_by_their_topics(
    bench: Bench, unique: Unique, robots: Path, old_robots: Path
) -> None:
    fine = kind_of('fine')
    sent = {prefix: random_cdr(fine, prefix / 'src', 9) for prefix in (robots, old_robots)}
    topics = {name: unique(name) for name in ('new', 'old', 'mixed')}
    routes = [from_robot(f'/{name}', topic, 'json') for name, topic in topics.items()]
    with ExitStack() as stack:

        def start(prefix: Path, name: str, kind: str, *options: str, **publishes: Any) -> None:
            messages = {f'/{topic}': sent for topic, sent in publishes.items()}
            named = '--name', name, *options
            stack.enter_context(robot(bench, kind_of(kind), prefix, *named, publishes=messages))

        start(old_robots, 'of_old', 'fine', old=sent[old_robots])
        for name, prefix in ('old_robot', old_robots), ('new_robot', robots):
            # One that describes it could be taken before the other is seen.
            start(prefix, name, 'both', '--describes', 'not', mixed=[])
        bridge = stack.enter_context(bench.bridge(bench.config(routes)))
        unknown = f'mixed: failed: no message type {kind_of("both")} here'
        bridge.wait_for(f'{unknown}, and nodes define it in 2 ways')
        old = bench.records(topics['old'], 9)
        start(robots, 'of_new', 'fine', new=sent[robots])
        new = bench.records(topics['new'], 9)
        assert bridge.end() == 0
    [error] = [line for line in bridge.output().split('\n') if 'in 2 ways' in line][:1]
    assert ' by /new_robot' in error
    assert ' by /old_robot' in error
    assert len({headers(it)['ros.type_hash'] for it in (*old, *new)}) == 2
    assert [json.loads(value).keys() for value in values(old)] == [{'number', 'text'}] * 9
    assert [json.loads(value).keys() for value in values(new)] == [{'text'}] * 9


def test_a_publisher_of_another_version_than_is_installed_here_describes_its_own(
    bench: Bench, unique: Unique, robots: Path, old_robots: Path
) -> None:
    fine, topic = kind_of('fine'), unique('fine')
    sent = random_cdr(fine, robots / 'src', 5)
    here: dict[str, Any] = {'AMENT_PREFIX_PATH': str(old_robots)}
    with (
        robot(bench, fine, robots, publishes={'/fine': sent}),
        bench.drained(bench.config([from_robot('/fine', topic, 'json')]), **here),
    ):
        records = bench.records(topic, 5)
    assert [json.loads(value).keys() for value in values(records)] == [{'text'}] * 5


@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGINT])
def test_a_bridge_that_asks_a_node_which_never_answers_is_stopped_as_any_other(
    bench: Bench, topic_name: str, robots: Path, number: signal.Signals
) -> None:
    silent = robot(bench, kind_of('never'), robots, '--describes', 'never', publishes={'/n': []})
    with silent as node, bench.bridge(bench.config([from_robot('/n', topic_name)])) as bridge:
        node.wait_for('asked')
        bridge.send(number)
        assert bridge.wait(4) == 0, 'an answer is waited for 5 s'
    said = bridge.output()
    assert 'nobody describes it' not in said, 'it has waited for the answer'
    assert 'Traceback' not in said
    assert 'left behind' not in said
