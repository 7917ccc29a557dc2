"""Types that are made, held against what the packages of this ROS give to rclpy."""

import gc
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
from support.formats.messages import new_message

from ros2_kafka_bridge.message_types import describe, type_names
from ros2_kafka_bridge.message_types.description import (
    FieldDescription,
    FieldType,
    Ids,
    TypeDescription,
)
from ros2_kafka_bridge.message_types.installed import has_key
from ros2_kafka_bridge.ros.type_support import comparison
from ros2_kafka_bridge.ros.type_support.comparison import difference, told_by
from ros2_kafka_bridge.ros.type_support.handle import endpoint_class
from ros2_kafka_bridge.ros.types import load_type

KEYED = [name for name in type_names() if has_key(name)]
OTHERS = [name for name in type_names() if name not in KEYED]
DESCRIPTIONS = 'description'


def made(name: str) -> type[Any]:
    return endpoint_class(name, describe(name).types)


@pytest.fixture(scope='module')
def all_made() -> dict[str, type[Any]]:
    """All at once, and with other things in what was free before they are looked at."""
    every = {name: made(name) for name in OTHERS}
    gc.collect()
    garbage = [bytearray(b'x' * size) for size in range(5000)]
    del garbage
    return every


@pytest.mark.parametrize('name', OTHERS)
def test_a_made_type_tells_rclpy_what_its_package_does(
    name: str, all_made: dict[str, type[Any]]
) -> None:
    of_package = told_by(load_type(name, 'import').endpoint_class)
    of_made = told_by(all_made[name])
    if name == 'test_msgs/msg/WStrings':  # ROS escapes what is not ASCII twice
        told = str([told for place, told in of_package.items() if DESCRIPTIONS in place])
        assert r'Hell\\xc3\\xb6 w\\xc3\\xb6rld!' in told
        of_package, of_made = (
            {place: told for place, told in all_told.items() if DESCRIPTIONS not in place}
            for all_told in (of_package, of_made)
        )
    elif name == 'test_msgs/msg/NonKeyedWithNestedKey':  # it has no key, what it holds has one
        of_package, of_made = (
            {place: told for place, told in all_told.items() if '.nested_data' not in place}
            for all_told in (of_package, of_made)
        )
    assert of_made == of_package


def test_a_type_with_a_key_is_that_of_its_package() -> None:
    """Fast DDS gives keyed topics other endpoints: without the key nobody would match."""
    assert [
        f'test_msgs/msg/{it}' for it in ('ComplexNestedKey', 'KeyedLong', 'KeyedString')
    ] == KEYED
    for name in KEYED:
        loaded = load_type(name)
        assert loaded.endpoint_class is type(new_message(name))
        assert told_by(loaded.endpoint_class)['rosidl_typesupport_fastrtps_c: has a key'] is True


def test_a_type_that_rclpy_has_no_package_of_is_made() -> None:
    text = FieldDescription('text', FieldType(Ids.STRING, 0, 0, ''))
    types = {'acme_msgs/msg/Thing': TypeDescription('acme_msgs/msg/Thing', (text,))}
    told = told_by(endpoint_class('acme_msgs/msg/Thing', types))
    assert told['rosidl_typesupport_fastrtps_c: namespace'] == b'acme_msgs::msg'
    assert told['rosidl_typesupport_fastrtps_c: name'] == b'Thing'
    assert told['type: description'] == tuple(types.values())


def test_the_same_description_is_the_same_class_and_another_one_is_another() -> None:
    """What the middleware keeps of a type is there once, however often a route begins anew."""
    name = 'nav_msgs/msg/Odometry'
    assert made(name) is made(name)
    types = describe(name).types
    header = types['std_msgs/msg/Header']
    changed = types | {header.type_name: TypeDescription(header.type_name, header.fields[1:])}
    other = endpoint_class(name, changed)
    assert other is not made(name)
    assert told_by(other)['type: hash'] != told_by(made(name))['type: hash']


def test_threads_that_make_a_type_at_once_get_the_same_class() -> None:
    """Of two, one would be let go, and the middleware would keep pointers into it."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        for number in range(30):
            assert len({*made_by_threads(f'acme_msgs/msg/Thing{number}')}) == 1
    finally:
        sys.setswitchinterval(before)


def made_by_threads(name: str) -> list[type[Any]]:
    text = FieldDescription('text', FieldType(Ids.STRING, 0, 0, ''))
    types = {name: TypeDescription(name, (text,) * 20)}
    begin = threading.Barrier(4)

    def make(_: int) -> type[Any]:
        begin.wait()
        return endpoint_class(name, types)

    with ThreadPoolExecutor(4) as threads:
        return list(threads.map(make, range(4)))


def test_this_ros_tells_what_the_table_says() -> None:
    assert difference() == ''


def test_the_first_thing_that_is_told_otherwise_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def without_last_field(name: str, types: dict[str, TypeDescription]) -> type[Any]:
        one = types[name]
        return endpoint_class(name, types | {name: TypeDescription(name, one.fields[:-1])})

    monkeypatch.setattr(comparison, 'endpoint_class', without_last_field)
    said = difference()
    assert said.startswith('rcl_interfaces/msg/ParameterEvent: type: hash is (1, ')
    assert ', expected was (1, ' in said


def test_a_ros_whose_types_cannot_be_read_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(comparison, '_KNOWN', ('rcl_interfaces/msg/Nothing',))
    assert difference().startswith('the types of rclpy cannot be read: AttributeError: module ')
