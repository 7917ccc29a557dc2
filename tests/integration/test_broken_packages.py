"""A message package that is broken ends its own route, in a bridge that runs.

Guarantee 6b: `tests/unit/ros/test_broken_packages.py` has what there is to be broken.
"""

from collections.abc import Callable
from pathlib import Path

from from_ros import publish, route, text
from harness import Bench, values
from scrapes import watched

from ros2_kafka_bridge.route.counters import State

POINT, ODOMETRY = 'geometry_msgs/msg/Point', 'nav_msgs/msg/Odometry'
JOINTS = 'sensor_msgs/msg/JointState'
BROKEN = {
    'geometry_msgs': 'def __init__(self, from): pass',
    'nav_msgs': 'raise RuntimeError("built for another ABI")',
    'sensor_msgs': 'import sys\nsys.exit("no licence")',
    'diagnostic_msgs': 'raise AssertionError',  # of the bridge's own node
}


def shadowed(folder: Path) -> str:
    """Broken packages, which hide those of the wheels; returns where Python finds them."""
    for package, code in BROKEN.items():
        (folder / package / 'msg').mkdir(parents=True)
        (folder / package / '__init__.py').touch()
        (folder / package / 'msg' / '__init__.py').write_text(code)
    return str(folder)


def test_guarantee_6b_broken_packages_end_their_own_routes_alone(
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
    bridge = watched(bench, routes, pythonpath=site, workers=2, node=True)
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


def test_check_says_of_a_broken_package_that_its_route_cannot_run(
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
    config = str(bench.config(routes))
    status, out, _ = bench.command('check', '--connect', config, PYTHONPATH=site)
    assert status == 1
    lines = ' '.join(out.split())
    assert f'message type {JOINTS} cannot be loaded: SystemExit: no licence' in lines
    assert f'message type {POINT} cannot be loaded: SyntaxError: invalid syntax' in lines
    assert '0 routes would run' in lines
