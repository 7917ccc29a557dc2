"""A message package that is broken: a bridge that runs does without it, or its route alone ends.

Guarantee 6b: `tests/unit/ros/test_broken_packages.py` has what there is to be broken.
"""

from collections.abc import Callable
from pathlib import Path

from support.bridges.routes import to_kafka, to_ros, values
from support.formats.messages import cdr
from support.monitoring.scrapes import watched
from support.processes.harness import Bench
from support.ros.package import install_package, write_package
from support.ros.raw import publish, reader_of, received, route, text

from ros2_kafka_bridge.route.counters import State

POINT, ODOMETRY = 'geometry_msgs/msg/Point', 'nav_msgs/msg/Odometry'
JOINTS = 'sensor_msgs/msg/JointState'
BROKEN = {
    'geometry_msgs': 'def __init__(self, from): pass',
    'nav_msgs': 'raise RuntimeError("built for another ABI")',
    'sensor_msgs': 'import sys\nsys.exit("no licence")',
    'diagnostic_msgs': 'raise AssertionError',  # of the bridge's own node
}


IMPORTED = {'packages': 'import'}


def shadowed(folder: Path) -> str:
    """Broken packages, which hide those of the wheels; returns where Python finds them."""
    for package, code in BROKEN.items():
        (folder / package / 'msg').mkdir(parents=True)
        (folder / package / '__init__.py').touch()
        (folder / package / 'msg' / '__init__.py').write_text(code)
    return str(folder)


def test_guarantee_6b_broken_packages_are_not_imported_and_their_routes_run(
    bench: Bench, unique: Callable[[str], str], tmp_path: Path
) -> None:
    points, odom, joints = unique('points'), unique('odom'), unique('joints')
    to_points = {'ros': '/points', 'type': POINT}
    routes = [
        to_ros(points, '/points', format='json') | {'name': 'points', 'to': to_points},
        route('/odom', odom, None, 'odom'),
        route('/joints', joints, JOINTS, 'joints'),
    ]
    site = shadowed(tmp_path / 'site')
    bench.create_topic(points)
    odometry, moved = cdr(ODOMETRY, child_frame_id='base'), cdr(JOINTS, name=['wrist', 'elbow'])
    latched = ('--durability', 'transient_local', '--readers', '0')
    with (
        reader_of(bench, POINT, '/points'),
        publish(bench, '/odom', [odometry], *latched, message_type=ODOMETRY),
        publish(bench, '/joints', [moved], *latched, message_type=JOINTS),
        bench.drained(bench.config(routes, workers=2), PYTHONPATH=site) as bridge,
    ):
        bench.produce(points, [b'{"x": 1.5, "y": 0, "z": -2}'])
        assert received(bench, 1, bridge, POINT) == [cdr(POINT, x=1.5, z=-2.0)]
        assert values(bench.records(odom, 1)) == [odometry]
        assert values(bench.records(joints, 1)) == [moved]
    assert 'cannot be loaded' not in bridge.output()


def test_a_type_with_a_field_that_is_a_keyword_of_python_goes_there_and_back(
    bench: Bench, unique: Callable[[str], str], tmp_path: Path
) -> None:
    """Nobody can import a type of that package, and no library of it is there."""
    package = write_package(tmp_path / 'src', 'acme_moves', {'Move': 'float64 from\nstring to\n'})
    install_package(package, tmp_path)
    there, back = unique('there'), unique('back')
    bench.create_topic(there)
    end = {'ros': '/moves', 'type': 'acme_moves/msg/Move'}
    routes = [
        to_ros(there, '/moves', format='json') | {'to': end},
        to_kafka('/moves', back, format='json') | {'from': end},
    ]
    with bench.drained(bench.config(routes), AMENT_PREFIX_PATH=str(tmp_path)):
        bench.produce(there, [b'{"from": 1.5, "to": "dock"}'])
        assert values(bench.records(back, 1)) == [b'{"from":1.5,"to":"dock"}']


def test_check_says_of_a_broken_package_that_nobody_imports_that_its_route_runs(
    bench: Bench, unique: Callable[[str], str], tmp_path: Path
) -> None:
    config = str(bench.config([route('/joints', unique('joints'), JOINTS, 'joints')]))
    site = shadowed(tmp_path / 'site')
    _, out, _ = bench.command('check', '--connect', config, PYTHONPATH=site)
    lines = ' '.join(out.split())
    assert f'{JOINTS} is installed here' in lines
    assert '1 route would run' in lines


def test_guarantee_6b_broken_packages_that_are_imported_end_their_own_routes_alone(
    bench: Bench, unique: Callable[[str], str], tmp_path: Path
) -> None:
    good = unique('good')
    points = {'name': 'points', 'from': {'kafka': unique('points')}, 'format': 'json'}
    points |= {'to': {'ros': '/points', 'type': POINT}}
    routes = [
        route('/good', good, None, 'good'),
        points,
        route('/odom', unique('odom'), None, 'odom'),
        route('/joints', unique('joints'), JOINTS, 'joints'),
    ]
    site = shadowed(tmp_path / 'site')
    latched = ('--durability', 'transient_local', '--readers', '0')
    odometry = publish(bench, '/odom', [bytes(720)], *latched, message_type=ODOMETRY)
    bridge = watched(bench, routes, pythonpath=site, workers=2, node=True, ros=IMPORTED)
    failed = 'cannot be loaded: '
    with odometry, bridge.process:
        for name, cause in (
            ('points', f'{POINT} {failed}SyntaxError: invalid syntax ({site}/geometry_msgs/msg'),
            ('odom', f'{ODOMETRY} {failed}RuntimeError: built for another ABI ({site}/nav_msgs'),
            ('joints', f'{JOINTS} {failed}SystemExit: no licence ({site}/sensor_msgs/msg'),
        ):
            bridge.process.wait_for(f'{name}: failed: message type {cause}')
        with publish(bench, '/good', [text(b'a'), text(b'b')], *latched):
            assert values(bench.records(good, 2)) == [text(b'a'), text(b'b')]
        own = (
            'the ROS node of the bridge cannot run, the routes go on: message type diagnostic_msgs'
        )
        bridge.process.wait_for(own)
        bridge.becomes('livez', 200)
        said = bridge.becomes('readyz', 503, '[+]route/good ok: running')
        assert f'[-]route/points failed: failed: message type {POINT} cannot be loaded' in said
        assert bridge.route('points')['state'] == State.FAILED
        bridge.process.end()
    assert 'Traceback' not in bridge.process.output()
    assert 'bug of the bridge' not in bridge.process.output()


def test_check_says_of_a_broken_package_that_is_imported_that_its_route_cannot_run(
    bench: Bench, unique: Callable[[str], str], tmp_path: Path
) -> None:
    routes = [
        route('/joints', unique('joints'), JOINTS, 'joints'),
        {
            'name': 'points', 'from': {'kafka': unique('points')}, 'format': 'json',
            'to': {'ros': '/points', 'type': POINT},
        },
    ]  # fmt: skip
    site = shadowed(tmp_path / 'site')
    config = str(bench.config(routes, ros=IMPORTED))
    status, out, _ = bench.command('check', '--connect', config, PYTHONPATH=site)
    assert status == 1
    lines = ' '.join(out.split())
    assert f'message type {JOINTS} cannot be loaded: SystemExit: no licence' in lines
    assert f'message type {POINT} cannot be loaded: SyntaxError: invalid syntax' in lines
    assert '0 routes would run' in lines
