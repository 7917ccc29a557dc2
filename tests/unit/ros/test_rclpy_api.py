"""The table of what the bridge uses of rclpy: complete, no row too many, and looked at."""

import ast
import re
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import make_dataclass
from functools import reduce
from importlib import import_module
from pathlib import Path
from typing import Any, Final, NamedTuple

import pytest
import rclpy.event_handler
import rclpy.service

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.ros import installation
from ros2_kafka_bridge.ros.control import lifecycle
from ros2_kafka_bridge.ros.rclpy_api import TABLE, NeededBy, Used, lacking

ROOM: Final = Path(installation.__file__).parent
C: Final = 'rclpy.impl.implementation_singleton.rclpy_implementation'
CONTEXT: Final = 'rclpy.Context'
DURATION: Final = 'rclpy.duration.Duration'
MIXIN: Final = 'rclpy.lifecycle.node.LifecycleNodeMixin'
NODE: Final = 'rclpy.node.Node'
PARAMETER: Final = 'rclpy.parameter.Parameter'
PUBLISHER: Final = 'rclpy.publisher.Publisher'
QOS: Final = 'rclpy.qos.QoSProfile'

OBJECTS: Final[dict[str, dict[str, str]]] = {
    'node.py': {
        'self.handle': NODE,
        'self.handle.context': CONTEXT,
        'context': CONTEXT,
        'node': NODE,
        'info': 'rclpy.node.TopicEndpointInfo',
        'qos': QOS,
    },
    'probe.py': {'publisher': PUBLISHER, 'publisher.handle': f'{C}.Publisher'},
    'profile_check.py': {'peer.qos': QOS, 'peer.qos.lifespan': DURATION},
    'qos.py': {
        'publisher': QOS,
        'subscription': QOS,
        'publisher.deadline': DURATION,
        'subscription.deadline': DURATION,
    },
    'rcl.py': {
        'context': CONTEXT,
        'self._end': f'{C}.GuardCondition',
        'self._node': NODE,
        'self._node.handle': f'{C}.Node',
        'self._wait_set': f'{C}.WaitSet',
        'subscription': 'rclpy.subscription.Subscription',
        'subscription.handle': f'{C}.Subscription',
    },
    'take.py': {
        'client': 'rclpy.client.Client',
        'client.handle': f'{C}.Client',
        'publisher': PUBLISHER,
        'subscription': 'rclpy.subscription.Subscription',
        'handle': f'{C}.Subscription',
        'self._event': f'{C}.EventHandle',
    },
    'topic_end.py': {'self.handle': PUBLISHER, 'self.node.handle': NODE, 'handle': NODE},
    'topic_writer.py': {'publisher.handle': PUBLISHER, 'handle': f'{C}.Publisher'},
    'trial.py': {'publisher': PUBLISHER},
    'type_request.py': {'client': 'rclpy.client.Client'},
    'control/lifecycle.py': {
        'self': MIXIN,
        'self._service_change_state': 'rclpy.service.Service',
        'self._state_machine': f'{C}.LifecycleStateMachine',
        'state': 'rclpy.lifecycle.LifecycleState',
    },
    'control/node.py': {
        'self._node': NODE,
        'self._node.get_clock()': 'rclpy.clock.Clock',
        'self._node.get_clock().now()': 'rclpy.time.Time',
        'self._publisher': PUBLISHER,
        'executor': 'rclpy.executors.MultiThreadedExecutor',
        'ManagedNode': NODE,
    },
    'control/services.py': {
        'node': NODE,
        'self._node': NODE,
        'self._node.get_parameter(parameter)': PARAMETER,
        'parameter': PARAMETER,
    },
}
"""What an expression of a file is in rclpy, where it does not say so itself."""

HANDLES: Final = {'node.handle': NODE, 'self._node.handle': NODE}
"""The same in every file."""

OWN: Final = ('_ask', '_log', '_follower', '_change_state')
"""What the objects of `ManagedNode` have beside its class."""


class Use(NamedTuple):
    """A use of rclpy in the sources; `positional` is None where nothing is called."""

    name: str
    positional: int | None = None
    named: frozenset[str] = frozenset()


Uses = dict[str, list[Use]]


class Names:
    """What the expressions of a file mean in rclpy."""

    def __init__(self, objects: dict[str, str], imported: dict[str, str], own: set[str]) -> None:
        self._objects = objects
        self._imported = imported
        self._own = own

    @classmethod
    def of(cls, path: Path, tree: ast.Module) -> 'Names':
        """Read the imports of a file, and what its class has of its own."""
        imported = {
            alias.asname or alias.name: f'{node.module}.{alias.name}'
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and f'{node.module}.'.startswith('rclpy.')
            for alias in node.names
        }
        objects = HANDLES | OBJECTS.get(str(path.relative_to(ROOM)), {})
        return cls(objects, imported | {'rclpy': 'rclpy'}, {*vars(lifecycle.ManagedNode), *OWN})

    def meant(self, node: ast.expr) -> str:
        """The whole name of what an expression means; empty where that is not of rclpy."""
        if isinstance(node, ast.Name):
            managed = self._objects.get(node.id, '') if node.id == 'ManagedNode' else ''
            return self._imported.get(node.id, managed)
        if not isinstance(node, ast.Attribute):
            return ''
        owner = ast.unparse(node.value)
        assert owner in self._objects or not owner.endswith('.handle'), f'{owner}: see HANDLES'
        if owner in self._objects:
            is_own = self._objects[owner] in {NODE, MIXIN} and node.attr in self._own
            return '' if is_own else f'{self._objects[owner]}.{node.attr}'
        above = self.meant(node.value) if owner.split('.')[0] in self._imported else ''
        return above and f'{above}.{node.attr}'


def uses_of(path: Path) -> Iterator[Use]:
    """All uses of rclpy in a file."""
    tree = ast.parse(path.read_text())
    names = Names.of(path, tree)
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and (name := names.meant(node.func)):
            positional = len(node.args)
            if name.endswith('.__init__'):
                name, positional = name.removesuffix('.__init__'), positional - 1
            if ast.unparse(node.func) == 'ManagedNode':
                positional = 1  # of its own arguments, the name goes on to the node
            named = frozenset(word.arg for word in node.keywords if word.arg)
            yield Use(name, positional, named)
        elif isinstance(node, ast.Attribute | ast.Name) and (name := names.meant(node)):
            yield Use(name.removesuffix('.__init__'))


@pytest.fixture(scope='module')
def uses() -> Uses:
    """All uses in the room, by their names."""
    found: Uses = defaultdict(list)
    for path in sorted(ROOM.rglob('*.py')):
        for use in uses_of(path):
            found[use.name].append(use)
    for step in {step for way in lifecycle._WAYS.values() for step in way}:
        name = f'{MIXIN}.trigger_{step}'  # which the source puts together
        found[name].append(Use(name, 0))
    return found


def test_whatever_the_room_uses_of_rclpy_has_a_row(uses: Uses) -> None:
    rows = {f'{row}.' for row in TABLE}
    without = {name for name in uses if not any(row.startswith(f'{name}.') for row in rows)}
    assert without == {'rclpy.__file__', f'{PARAMETER}.partition'}  # of a module; of a str


def test_no_row_is_left_of_what_nobody_uses_any_more(uses: Uses) -> None:
    assert {str(row) for row in TABLE} - uses.keys() == set()
    assert len({(str(row), row.part) for row in TABLE}) == len(TABLE)


def test_what_is_used_outside_of_the_managed_node_is_looked_at_without_it() -> None:
    outside = (path for path in ROOM.rglob('*.py') if ROOM / 'control' not in path.parents)
    used = {use.name for path in outside for use in uses_of(path)}
    assert not used & {str(row) for row in TABLE if row.part is NeededBy.MANAGED_NODE}


@pytest.mark.parametrize('row', TABLE, ids=str)
def test_a_row_has_the_arguments_that_the_room_passes(row: Used, uses: Uses) -> None:
    calls = [use for use in uses[str(row)] if use.positional is not None]
    most = max((use.positional or 0 for use in calls), default=0)
    assert {*row.named.split()} == {name for use in calls for name in use.named}
    assert most == (row.positional or 0)


def test_what_no_release_promises_is_used_for_taking_waiting_and_the_managed_node_alone() -> None:
    private = [str(row).replace(C, 'C') for row in TABLE if re.search(r'\.(_|impl\.)', str(row))]
    assert private == [
        'C.Client.take_response',
        'C.EventHandle',
        'C.EventHandle.destroy_when_not_in_use',
        'C.EventHandle.take_event',
        'C.Publisher.publish_raw',
        'C.RCLError',
        'C.Subscription.pointer',
        'C.Subscription.take_message',
        'C.GuardCondition',
        'C.GuardCondition.trigger_guard_condition',
        'C.Node.pointer',
        'C.WaitSet',
        'C.WaitSet.add_guard_condition',
        'C.WaitSet.clear_entities',
        'C.WaitSet.is_ready',
        'C.WaitSet.pointer',
        'C.WaitSet.wait',
        'C.LifecycleStateMachine.available_transitions',
        'C.LifecycleStateMachine.current_state',
        f'{MIXIN}._service_change_state',
        f'{MIXIN}._state_machine',
    ]


# The look


@pytest.mark.parametrize('part', NeededBy)
def test_the_rclpy_that_is_installed_has_all(part: NeededBy) -> None:
    assert lacking(part) == []


@pytest.mark.parametrize('row', TABLE, ids=str)
def test_whatever_is_not_there_is_told(row: Used, monkeypatch: pytest.MonkeyPatch) -> None:
    *way, last = row.name.split('.')
    around: Any = reduce(getattr, way[:-1], import_module(row.module))
    owner = getattr(around, way[-1]) if way else around
    if isinstance(owner, type):
        monkeypatch.setattr(around, way[-1], type('Other', (), {}))
    else:
        monkeypatch.delattr(owner, last)
    assert str(row) in lacking(row.part)


def test_a_module_that_is_not_there_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, 'rclpy.event_handler', None)  # as Humble has none
    assert [name for name in lacking(NeededBy.ROUTES) if 'event_handler' in name] == [
        'rclpy.event_handler.PublisherEventCallbacks',
        'rclpy.event_handler.QoSPublisherEventType.RCL_PUBLISHER_MATCHED',
        'rclpy.event_handler.SubscriptionEventCallbacks',
    ]


@pytest.mark.parametrize('module', ['rclpy.service', 'rclpy.publisher'])
def test_a_class_of_objects_that_rclpy_hands_out_may_be_anywhere(
    monkeypatch: pytest.MonkeyPatch, module: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    assert [*lacking(NeededBy.ROUTES), *lacking(NeededBy.MANAGED_NODE)] == []


def test_fields_of_a_frozen_dataclass_are_there(monkeypatch: pytest.MonkeyPatch) -> None:
    way = 'rclpy.node.TopicEndpointInfo'
    fields = [row.name.split('.')[1] for row in TABLE if str(row).startswith(f'{way}.')]
    monkeypatch.setattr(way, make_dataclass('TopicEndpointInfo', fields, frozen=True))
    assert lacking(NeededBy.ROUTES) == []


def test_what_is_of_c_is_looked_at_by_its_name_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    # It has a signature, as what pybind11 makes may have one day, and counts `self` in it.
    monkeypatch.setattr(f'{C}.EventHandle.take_event', list.append)
    assert lacking(NeededBy.ROUTES) == []


def test_what_takes_other_arguments_is_told_with_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rclpy, 'init', lambda *, args=None, context=None: (args, context))
    [told] = lacking(NeededBy.ROUTES)
    assert told == "rclpy.init (got an unexpected keyword argument 'domain_id')"


def test_an_rclpy_that_lacks_something_of_others_is_not_called_too_old(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def no_module(name: str) -> None:
        raise ModuleNotFoundError(f'No module named {name!r}', name='rcl_interfaces')

    monkeypatch.setattr('ros2_kafka_bridge.ros.rclpy_api.import_module', no_module)
    with pytest.raises(ModuleNotFoundError):
        lacking(NeededBy.ROUTES)


def test_a_worker_does_not_load_what_the_managed_node_needs() -> None:
    program = (
        'import sys\n'
        'from ros2_kafka_bridge.ros import installation, rclpy_api\n'
        'installation.check_alone()\n'
        'installation.check_api(rclpy_api.NeededBy.ROUTES)\n'
        'heavy = {"rclpy.lifecycle", "diagnostic_msgs", "lifecycle_msgs", "importlib.metadata"}\n'
        'assert not heavy & {*sys.modules}, heavy & {*sys.modules}'
    )
    subprocess.run([sys.executable, '-c', program], check=True, timeout=60)


# The sentence


def test_the_sentence_names_the_rclpy_and_three_of_what_it_lacks() -> None:
    said = installation.refusal('3.3.17', Path('/opt/ros/humble/rclpy'), ['a', 'b', 'c', 'd', 'e'])
    assert said == (
        'rclpy 3.3.17 of /opt/ros/humble/rclpy is too old: it does not have what the bridge '
        'calls: a, b, c and 2 more: source a ROS that is supported, Jazzy (rclpy 7) or newer '
        '(README.md, What is supported)'
    )


def test_a_newer_one_is_not_called_old() -> None:
    said = installation.refusal('12.0.1', Path('/opt/ros/next/rclpy'), ['rclpy.init'])
    assert ' is too new, or changed: ' in said
    assert said.count('rclpy.init: source') == 1


def test_one_of_an_unknown_version_is_told_as_that() -> None:
    said = installation.refusal('', Path('/ws/rclpy'), ['rclpy.init'])
    assert said.startswith('rclpy of an unknown version of /ws/rclpy is too new, or changed')


@pytest.mark.parametrize(
    ('folder', 'version', 'major'),
    [
        ('rclpy-9.1.2-py3.11.egg-info', '9.1.2', 9),
        ('rclpy-3.3.11.dist-info', '3.3.11', 3),
        ('rclpy-10.0.10-py3.14.egg-info', '10.0.10', 10),
    ],
)
def test_the_version_is_that_of_the_folder_beside_it(
    folder: str, version: str, major: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / folder).mkdir()
    monkeypatch.setattr(rclpy, '__file__', str(tmp_path / 'rclpy' / '__init__.py'))
    assert installation.rclpy_version() == version
    assert installation.rclpy_major(version) == major


# Two at once


def test_wheels_behind_another_rclpy_are_refused_with_both_places(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = tmp_path / 'rclpy'
    wheels = installation.rclpy_folder().parent
    monkeypatch.setattr(rclpy, '__file__', str(other / '__init__.py'))
    with pytest.raises(ConfigError, match=f'{other}, and the wheels of ROS 2 are in {wheels}: '):
        installation.check_alone()


def test_an_overlay_over_a_ros_that_is_no_wheel_is_not_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    overlay, conda = tmp_path / 'overlay', tmp_path / 'conda'
    for place in (overlay, conda):
        (place / 'rclpy').mkdir(parents=True)
        (place / 'rclpy-7.1.5-py3.11.egg-info').mkdir()
    monkeypatch.setattr(sys, 'path', [str(overlay), str(conda)])
    monkeypatch.setattr(rclpy, '__file__', str(overlay / 'rclpy' / '__init__.py'))
    installation.check_alone()


def test_the_wheels_by_another_way_are_the_same_wheels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / 'link').symlink_to(installation.rclpy_folder())
    monkeypatch.setattr(rclpy, '__file__', str(tmp_path / 'link' / '__init__.py'))
    installation.check_alone()
