"""Types that are not installed where the bridge runs: packages that are built, other ROS, many.

What a user meets first is in tests/integration/test_types_of_others.py.
"""

import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from support.bridges.routes import lines, to_kafka, to_ros, values
from support.install.checkout import example
from support.patience import patient
from support.processes.harness import PEERS, Bench, Process, eventually, headers
from support.ros.package import build_package, write_package
from support.ros.robots import ends, installed, random_cdr, robot

from rig.processes import Programs

JAZZY = Path(__file__).parents[2] / '.venv-jazzy' / 'bin' / 'python'
NEEDS = ['geometry_msgs', 'std_msgs', 'builtin_interfaces']
LATCHED = {'durability': 'transient_local'}
FINE = 'acme_tf/msg/Fine'
TF = 'tf2_msgs/msg/TFMessage'
TF_MESSAGES = {'TFMessage': 'geometry_msgs/TransformStamped[] transforms\n'}
PLAN = 'acme_nav/msg/Plan'
NAV_MESSAGES = {
    'Plan': """\
# As of a stack for navigation.
uint16 NONE=0
uint16 NO_WAY=208
string PLANNER="grid"

std_msgs/Header header
string<=32 planner "grid"
Leg[] legs
Leg[2] ends
Stop[<=3] stops
geometry_msgs/PoseStamped goal
builtin_interfaces/Duration planning_time
uint16 error_code 208
string error_msg
""",
    'Leg': 'geometry_msgs/Pose[] poses\nfloat32[] costs\nint8[4] flags\nbool is_last\n',
    'Stop': 'wstring name\nbyte[] raw\nstring<=8[<=2] doors\n',
}


def of_robots(bench: Bench) -> Programs:
    """Processes with an environment of their own, begun by a command."""
    return Programs(bench.place, {'ROS_DOMAIN_ID': str(bench.domain)})


@contextmanager
def packaged(bench: Bench, name: str, built: dict[str, str], *words: str) -> Iterator[Process]:
    """An ordinary node with the package of its type, which sends and takes objects of it."""
    command = '-m', 'rig.peers.ros_node', '--typed', '--name', name, *words
    with of_robots(bench).python(name, *command, **built) as node:
        yield node


def told(words: Sequence[str]) -> list[str]:
    """What an ordinary node with these ends has published, as Python prints it."""
    return lines(Path(words[1]).with_suffix('.sent'))


def assert_without(bridge: Process, package: str, prefix: Path) -> None:
    """A bridge has nothing of a package: neither where to find it, nor a library of it."""
    proc = Path('/proc', str(bridge.pid))
    assert 'ros2_kafka_bridge' in (proc / 'cmdline').read_text()
    assert str(prefix) not in (proc / 'environ').read_text()
    assert package not in (proc / 'maps').read_text()
    assert find_spec(package) is None, 'the same Python'


def test_tf_of_nodes_that_have_tf2_msgs_goes_both_ways_through_a_bridge_that_has_not(
    own_bench: Bench,
) -> None:
    bench, prefix = own_bench, own_bench.place / 'install'
    package = write_package(bench.place / 'src', 'tf2_msgs', TF_MESSAGES)
    built = build_package(package, prefix, NEEDS)
    bench.create_topic('site-1.map', 'site-1.tf_static', 'site-1.tf')
    sent = {
        'tf_static': random_cdr(TF, package, 20),
        'tf': random_cdr(TF, package, 300),
    }
    back = [
        to_ros(f'site-1.{it}', f'/site_1/{it}', it, format='cdr')
        | {'to': {'ros': f'/site_1/{it}', 'type': TF, 'qos': LATCHED}}
        for it in sent
    ]
    tf = {'name': 'tf_out', 'from': {'ros': '/tf'}, 'to': {'kafka': 'site-1.tf'}, 'format': 'json'}
    back[1] |= {'format': 'json'}
    came = {f'/site_1/{it}': bench.place / f'{it}.came' for it in sent}
    statics, moves = (ends(bench, TF, {f'/{it}': sent[it]}, {}) for it in sent)
    with ExitStack() as stack:
        enter = stack.enter_context
        enter(packaged(bench, 'statics', built, *statics))
        enter(packaged(bench, 'rviz', built, *ends(bench, TF, {}, came)))
        static = enter(bench.run(example(bench, 'latched')))
        others = enter(bench.run(bench.config([tf, *back])))
        now = '--durability', 'volatile', '--readers', '1'
        enter(packaged(bench, 'moving', built, *moves, *now))
        for (it, messages), words in zip(sent.items(), (statics, moves), strict=True):
            file = came[f'/site_1/{it}']
            eventually(lambda: len(lines(file)) >= len(messages), 90, others.output)  # noqa: B023
            assert lines(file) == told(words)
            assert 'TransformStamped' in lines(file)[1]
        for bridge in (static, others):
            assert_without(bridge, 'tf2_msgs', prefix)
            assert bridge.end() == 0
    assert values(bench.records('site-1.tf_static', 20)) == sent['tf_static']
    assert f'tf_static: {TF} is described by the node /statics' in static.output()


def test_plans_of_a_built_package_come_back_as_the_same_objects(
    bench: Bench, unique: Callable[[str], str]
) -> None:
    prefix = bench.place / 'install'
    package = write_package(bench.place / 'src', 'acme_nav', NAV_MESSAGES)
    built = build_package(package, prefix, NEEDS)
    forms: dict[str, dict[str, Any]] = {
        'json': {'format': 'json'},
        'avro': {'format': 'avro', 'schema': {'registry': False}},
        'protobuf': {'format': 'protobuf', 'schema': {'registry': False}},
    }
    routes = []
    for form, settings in forms.items():
        topic = unique(form)
        bench.create_topic(topic)
        sink = {'ros': f'/{form}', 'type': PLAN, 'qos': LATCHED}
        routes += [
            to_kafka('/plan', topic, f'{form}_out') | {'from': {'ros': '/plan'}} | settings,
            to_ros(topic, f'/{form}', form) | {'to': sink} | settings,
        ]
    came = {f'/{form}': bench.place / form for form in forms}
    words = ends(bench, PLAN, {'/plan': random_cdr(PLAN, package, 100)}, came)
    with (
        packaged(bench, 'planner', built, *words),
        bench.run(bench.config(routes)) as bridge,
    ):
        for file in came.values():
            eventually(lambda: len(lines(file)) >= 100, 60, bridge.output)  # noqa: B023
        assert_without(bridge, 'acme_nav', prefix)
        assert bridge.end() == 0
    assert [lines(file) for file in came.values()] == [told(words)] * 3


# Others than nodes of this ROS


@pytest.fixture
def fine(tmp_path: Path) -> Path:
    """A package of one type, on the robots alone."""
    return installed(tmp_path / 'fine', 'acme_tf', {'Fine': 'string data\n', 'Off': 'int64 x\n'})


def test_those_of_another_vendor_have_no_node_to_ask_and_a_folder_helps(
    bench: Bench, unique: Callable[[str], str], fine: Path
) -> None:
    there, back = unique('there'), unique('back')
    bench.create_topic(back)
    bench.produce(back, [b'{"data":"%d"}' % number for number in range(10)])
    routes = [
        {'name': 'out', 'from': {'ros': '/out'}, 'to': {'kafka': there}, 'format': 'json'},
        to_ros(back, '/back', format='json') | {'to': {'ros': '/back', 'type': FINE}},
    ]
    came = bench.place / 'came'
    with (
        bench.peer('cyclone', 'write', '/out', '--count', '10', '--type', FINE) as writer,
        bench.peer('cyclone', 'read', '/back', '--file', str(came), '--type', FINE),
    ):
        with bench.drained(bench.config(routes)) as bridge:
            for name in ('out', 'to_ros'):
                bridge.wait_for(f'{name}: failed: no message type {FINE} here, and nobody there')
        assert 'nobody there tells how it is defined' in bridge.output()
        assert 'put its .msg files into a folder of ros.message_path' in bridge.output()
        known = bench.config(routes, ros={'message_path': [str(fine / 'src')]})
        with bench.drained(known) as bridge:
            writer.wait_for('published')
            assert values(bench.records(there, 10)) == [b'{"data":"%d"}' % n for n in range(10)]
            eventually(lambda: len(lines(came)) >= 10, 60, bridge.output)
    assert lines(came) == [str(number) for number in range(10)]


@pytest.mark.parametrize(('bridges', 'robots'), [('jazzy', 'kilted'), ('kilted', 'jazzy')])
def test_jazzy_and_kilted_describe_types_to_each_other(
    bench: Bench, unique: Callable[[str], str], fine: Path, bridges: str, robots: str
) -> None:
    topic = unique('fine')
    bench.create_topic(topic)
    pythons = {'jazzy': str(JAZZY), 'kilted': sys.executable}
    own = {'_ROS_WHEELS_BOOTSTRAP_COMPLETE': '', 'LD_LIBRARY_PATH': ''}
    sent = random_cdr(FINE, fine / 'src', 20)
    came = bench.place / 'came'
    words = ends(bench, FINE, {'/out': sent}, {'/back': came})
    command = [pythons[robots], '-m', 'rig.peers.ros_node', '--made', str(fine), *words]
    routes = [
        {'name': 'out', 'from': {'ros': '/out'}, 'to': {'kafka': topic}, 'format': 'json'},
        to_ros(topic, '/back', format='json')
        | {'to': {'ros': '/back', 'type': FINE, 'qos': LATCHED}},
    ]
    python = JAZZY if bridges == 'jazzy' else None
    with (
        of_robots(bench).command('robot', *command, **own) as node,
        bench.drained(bench.config(routes), python=python) as bridge,
    ):
        node.wait_for('ready')
        eventually(lambda: len(lines(came)) >= 20, 60, bridge.output)
        records = bench.records(topic, 20)
    assert [
        bytes.fromhex(line)[: len(it)] for line, it in zip(lines(came), sent, strict=True)
    ] == sent
    assert headers(records[0])['ros.type_hash'].startswith('RIHS01_')
    assert bridge.output().count(f'{FINE} is described by the node /robot_') == 2


def test_a_silent_node_holds_up_no_route_of_another_topic_with_the_same_type(
    bench: Bench, unique: Callable[[str], str], fine: Path
) -> None:
    topics = {name: unique(name) for name in ('mute', 'fine')}
    sent = random_cdr(FINE, fine / 'src', 5)
    routes = [
        to_kafka(f'/{name}', topic, name, format='cdr') | {'from': {'ros': f'/{name}'}}
        for name, topic in topics.items()
    ]
    with (
        robot(bench, FINE, fine, '--describes', 'never', publishes={'/mute': sent}) as mute,
        bench.drained(bench.config(routes)) as bridge,
    ):
        mute.wait_for('asked')
        with robot(bench, FINE, fine, publishes={'/fine': sent}):
            assert values(bench.records(topics['fine'], 5)) == sent
            assert 'fine: failed' not in bridge.output()
            # What one node has told counts for all.
            assert values(bench.records(topics['mute'], 5)) == sent


# Many


def many(bench: Bench, prefix: Path, types: int, count: int) -> Process:
    """A node with many topics of types that it alone describes, a message on each."""
    sends = bench.place / 'many.sends'
    sends.write_text(
        ''.join(
            f'/t{it} acme_many/msg/T{it % types} {numbered_cdr(it).hex()}\n' for it in range(count)
        )
    )
    return bench.peer('ros_node', '--made', str(prefix), '--publish', str(sends))


def numbered_cdr(number: int) -> bytes:
    return b'\0\1\0\0' + number.to_bytes(8, 'little')


def test_250_routes_learn_fifty_types_of_one_node(bench: Bench, topic_name: str) -> None:
    types, count = 50, 250
    messages = {f'T{it}': f'uint64 x{it}\n' for it in range(types)}
    prefix = installed(bench.place / 'many', 'acme_many', messages)
    routes = [
        to_kafka(f'/t{it}', topic_name, f'r{it}', format='cdr') | {'from': {'ros': f'/t{it}'}}
        for it in range(count)
    ]
    node = many(bench, prefix, types, count)
    config = bench.config(routes)
    with node:
        node.wait_for('ready')
        began_s = time.monotonic()
        with bench.run(config) as bridge:
            records = bench.records(topic_name, count, 120)
            print(f'{count} routes after {time.monotonic() - began_s:.1f} s, {resident(bridge)}')  # noqa: T201
            assert bridge.end() == 0
    assert sorted(values(records)) == sorted(map(numbered_cdr, range(count)))
    assert len({headers(record)['ros.type_hash'] for record in records}) == types


def test_a_process_has_1_000_endpoints_of_types_that_a_node_alone_describes(bench: Bench) -> None:
    types, count = 50, 1000
    messages = {f'T{it}': f'uint64 x{it}\n' for it in range(types)}
    prefix = installed(bench.place / 'many', 'acme_many', messages)
    node = many(bench, prefix, types, count)
    taker = bench.script('takes_many.py', str(count), str(bench.domain))
    with node:
        node.wait_for('ready')
        with taker:
            taker.wait_for(f'took {count} in')
            print(taker.output())  # noqa: T201


def resident(process: Process) -> str:
    [found] = re.findall(r'VmRSS:.*', Path(f'/proc/{process.pid}/status').read_text())
    return str(found)


def grown(*command: str | Path) -> list[int]:
    """The numbers that a peer prints of its memory."""
    done = subprocess.run(
        [sys.executable, *command],
        stdout=subprocess.PIPE,
        text=True,
        timeout=patient(200),
        check=True,
    )
    print(done.stdout)  # noqa: T201
    return [int(number) for number in re.findall(r'-?\d+', done.stdout)]


@pytest.mark.usefixtures('ros_domain')
def test_memory_does_not_grow_with_20_000_endpoints_that_come_and_go() -> None:
    threads, times = 8, 1250
    [kb] = grown(PEERS / 'made_types_churn.py', str(threads), str(times), '--memory')
    # rclpy and Fast DDS keep some 0.3 kB of each, of whatever type.
    assert kb < 2 * threads * times * 3 // 4, 'a kB for each since a quarter of them'


def test_memory_and_files_do_not_grow_with_200_questions(bench: Bench, fine: Path) -> None:
    with robot(bench, FINE, fine, publishes={'/fine': []}):
        kb, files = grown(PEERS / 'asks_again.py', '200', '/fine', FINE)
    assert files == 0
    assert kb < 1000


# Ends


@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGINT])
def test_a_bridge_of_the_command_line_ends_while_a_node_does_not_answer(
    bench: Bench, topic_name: str, fine: Path, number: signal.Signals
) -> None:
    """Ten times: the thread that asks still runs when Python ends."""
    routes = [to_kafka('/off', topic_name, 'off', format='cdr') | {'from': {'ros': '/off'}}]
    config = bench.config(routes)
    silent = robot(bench, 'acme_tf/msg/Off', fine, '--describes', 'not', publishes={'/off': []})
    with silent:
        for pause_s in range(10):
            with bench.run(config) as bridge:
                bridge.wait_for('runs 1 route on')
                time.sleep(0.2 * pause_s)
                bridge.send(number)
                began_s = time.monotonic()
                assert bridge.wait() == 0
                print(f'ended in {time.monotonic() - began_s:.2f} s')  # noqa: T201
            for word in ('Traceback', 'nobody describes it', 'left behind', 'Error'):
                assert word not in bridge.output()
