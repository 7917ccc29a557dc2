"""`schema --from-graph` where the graph tells more than one thing, or nothing."""

from pathlib import Path

import pytest
from support.bridges.routes import to_kafka, to_ros
from support.processes.harness import Bench
from support.ros.robots import installed, robot

from ros2_kafka_bridge.message_types import load_layout

PLAN = 'acme_plans/msg/Plan'
MESSAGES = {'Plan': 'Step[<=3] steps\n', 'Step': 'int32 number 7\n'}
OTHER = MESSAGES | {'Step': 'float64 metres\n'}
AS_MSG = ('--from-graph', '--format', 'msg')


@pytest.fixture(scope='module')
def new(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What is installed on robots."""
    return installed(tmp_path_factory.mktemp('new'), 'acme_plans', MESSAGES)


@pytest.fixture(scope='module')
def old(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What is installed on others."""
    return installed(tmp_path_factory.mktemp('old'), 'acme_plans', OTHER)


def test_a_route_means_the_type_that_is_used_on_its_topic(
    bench: Bench, new: Path, old: Path
) -> None:
    routes = [
        to_kafka('/plan', 'plans', name='out') | {'from': {'ros': '/plan'}, 'format': 'json'},
        to_ros('back', '/back', name='in')
        | {'to': {'ros': '/back', 'type': PLAN}, 'format': 'json'},
    ]
    config = ('--config', str(bench.config(routes)))
    takes = {'/back': bench.place / 'took'}
    with (
        robot(bench, PLAN, new, '--name', 'amr', publishes={'/plan': []}),
        robot(bench, PLAN, old, '--name', 'agv', takes=takes),
    ):
        out = bench.command('schema', *AS_MSG, *config, '--route', 'out')
        back = bench.command('schema', *AS_MSG, *config, '--route', 'in')
        both = bench.command('schema', PLAN, *AS_MSG)
        src = str(old / 'src')
        known = bench.command('schema', PLAN, *AS_MSG, '--message-path', src)
    begin = f'acme_plans/Step[<=3] steps\n{"=" * 80}\nMSG: acme_plans/Step\n'
    assert out == (0, f'{begin}int32 number 7\n', f'{PLAN} is described by the node /amr\n')
    assert back == (0, f'{begin}float64 metres\n', f'{PLAN} is described by the node /agv\n')
    assert both[:2] == (1, '')
    of_new, of_old = (load_layout(PLAN, [one / 'src']).type_hash for one in (new, old))
    assert f'{of_new} by /amr' in both[2]
    assert f'{of_old} by /agv' in both[2]
    from_folder = f'{PLAN} is described by {src}/{PLAN}.msg, as /agv has it'
    said = f'{from_folder}; not so {of_new} by /amr\n'
    assert known == (0, f'{begin}float64 metres\n', said)


def test_a_definition_of_the_graph_that_nobody_describes_is_not_taken_for_the_known_one(
    bench: Bench, new: Path, old: Path
) -> None:
    silent = ('--describes', 'not', '--name', 'amr')
    with robot(bench, PLAN, new, *silent, publishes={'/plan': []}):
        asked = ('schema', PLAN, *AS_MSG, '--message-path', str(old / 'src'))
        status, out, err = bench.command(*asked)
    assert (status, out) == (1, '')
    assert (
        f'otherwise than nodes use it ({load_layout(PLAN, [new / "src"]).type_hash} by /amr' in err
    )
    assert 'nobody describes it: /amr has not answered' in err


def test_a_type_that_nobody_uses_is_told_with_what_to_look_for(bench: Bench) -> None:
    routes = [to_kafka('/plan', 'plans', name='out') | {'from': {'ros': '/plan'}}]
    of_route = ('--config', str(bench.config(routes)), '--route', 'out')
    domain = f'in ROS domain {bench.environ["ROS_DOMAIN_ID"]} (ROS_DOMAIN_ID) that'
    for asked, does in (((PLAN,), f'uses {PLAN}: '), (of_route, 'publishes on /plan: ')):
        status, out, err = bench.command('schema', *AS_MSG, *asked)
        assert (status, out) == (1, '')
        assert err.startswith(f'no node is seen {domain} {does}')
