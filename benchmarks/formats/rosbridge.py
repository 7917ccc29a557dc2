"""The way of rosbridge: each value is converted by the name of its type, and checked on the way.

It takes the steps of `rosbridge_library.internal.message_conversion` with its default encoder:
base64 for uint8[], null for NaN and infinity, the type of a message read from its text, and a
question to each value on the way back.
"""

import array
import importlib
import json
import math
import re
from base64 import standard_b64decode, standard_b64encode
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from builtin_interfaces.msg import Duration, Time
from rclpy.clock import ROSClock
from rclpy.serialization import deserialize_message, serialize_message

_BY_PYTHON: Final = {
    'bool': ['bool', 'boolean'],
    'int': [
        'int8', 'octet', 'uint8', 'char', 'int16', 'uint16', 'int32', 'uint32', 'int64', 'uint64',
    ],
    'float': ['float32', 'float64', 'double', 'float'],
    'str': ['string'],
}  # fmt: skip
_PRIMITIVES: Final = [name for names in _BY_PYTHON.values() for name in names]
_LISTS: Final = [list, tuple, np.ndarray, array.array]
_TIMES: Final = ['builtin_interfaces/Time', 'builtin_interfaces/Duration']
_HEADERS: Final = ['Header', 'std_msgs/Header', 'roslib/Header']
_BINARY: Final = ['uint8[]', 'char[]', 'sequence<uint8>', 'sequence<char>']
_BRACES: Final = [
    ('uint8[]', re.compile(r'uint8\[[^\]]*\]')),
    ('char[]', re.compile(r'char\[[^\]]*\]')),
]
_IN_SEQUENCE: Final = re.compile(r'<(.+?)(, \d+)?>')
_IN_ARRAY: Final = re.compile(r'(.+)\[.*\]')


def make_to_record(python_class: type[Any]) -> Callable[[bytes], bytes]:
    """Make the function from CDR bytes to JSON."""

    def to_record(cdr: bytes) -> bytes:
        message = deserialize_message(cdr, python_class)
        return json.dumps(_plain(message, _type_of(message))).encode()

    return to_record


def make_to_message(python_class: type[Any]) -> Callable[[bytes], bytes]:
    """Make the function from JSON to CDR bytes."""

    def to_message(record: bytes) -> bytes:
        message = python_class()
        type_name = _type_of(message)
        _made(json.loads(record), type_name, type_name, message, [])
        return bytes(serialize_message(message))

    return to_message


def _type_of(message: Any) -> str:
    words = str(message).split('.')
    return '{}/{}'.format(words[0], words[2].split('(')[0])


def _is_binary(type_name: str) -> bool:
    return any(braces.sub(binary, type_name) in _BINARY for binary, braces in _BRACES)


def _item_type(type_name: str) -> str:
    found = _IN_SEQUENCE.search(type_name) or _IN_ARRAY.search(type_name)
    assert found is not None
    return found[1]


# ROS -> JSON


def _plain(value: Any, type_name: str) -> Any:
    if _is_binary(type_name):
        return standard_b64encode(value).decode('ascii')
    if type_name in _TIMES:
        return {'sec': value.sec, 'nanosec': value.nanosec}
    if type_name in _PRIMITIVES:
        return _plain_primitive(value, type_name)
    if type(value) in _LISTS:
        return _plain_list(value, type_name)
    fields = value.get_fields_and_field_types()
    return {name: _plain(getattr(value, name), kind) for name, kind in fields.items()}


def _plain_primitive(value: Any, type_name: str) -> Any:
    if type_name in _BY_PYTHON['float'] and (math.isnan(value) or math.isinf(value)):
        return None
    return int.from_bytes(value, 'little') if type_name == 'octet' else value


def _plain_list(values: Any, type_name: str) -> list[Any]:
    if not len(values):
        return []
    item = _item_type(type_name)
    if item in _PRIMITIVES:
        if isinstance(values, np.ndarray):
            return list(values.tolist())
        if item not in _BY_PYTHON['float']:
            return list(values)
    return [_plain(value, item) for value in values]


# JSON -> ROS


def _made(value: Any, type_name: str, root: str, present: Any, path: list[str]) -> Any:
    if _is_binary(type_name):
        return list(standard_b64decode(value)) if isinstance(value, str) else value
    if type_name in _TIMES:
        return _made_time(value, type_name, present)
    if type_name in _PRIMITIVES:
        return _made_primitive(value, type_name, root, path)
    if present is not None and type(present) in _LISTS:
        return _made_list(value, type_name, root, present, path)
    if present is None:
        present = _new(type_name)
    return _made_message(value, type_name, root, present, path)


def _new(type_name: str) -> Any:
    package, _, short = type_name.partition('/')
    return getattr(importlib.import_module(f'{package}.msg'), short)()


def _made_time(value: Any, type_name: str, present: Any) -> Any:
    made = present
    if made is None:
        made = Time() if type_name.endswith('Time') else Duration()
    for here, names in (('sec', ('sec', 'secs')), ('nanosec', ('nanosec', 'nsecs'))):
        for name in names:
            if name in value:
                setattr(made, here, value[name])
                break
    return made


def _made_primitive(value: Any, type_name: str, root: str, path: list[str]) -> Any:
    if isinstance(value, int) and type_name in _BY_PYTHON['float']:
        value = float(value)
    if type_name == 'octet' and isinstance(value, int):
        return bytes([value])
    kind = type(value)
    if kind in (bool, int, float, str) and type_name in _BY_PYTHON[kind.__name__]:
        return value
    raise TypeError(f'{root} requires a {type_name} for {".".join(path)}, but got a {kind}')


def _made_list(value: Any, type_name: str, root: str, present: Any, path: list[str]) -> Any:
    if type(value) not in _LISTS:
        raise TypeError(f'{root} requires a list for {".".join(path)}, but got a {type(value)}')
    if not len(value):
        return []
    if isinstance(present, array.array):
        del present[:]
        present.extend(value)
        return present
    if isinstance(present, np.ndarray):
        present[:] = value
        return present
    item = _item_type(type_name)
    return [_made(one, item, root, None, path) for one in value]


def _made_message(value: Any, type_name: str, root: str, present: Any, path: list[str]) -> Any:
    if not isinstance(value, dict):
        raise TypeError(f'{root} requires an object for {".".join(path)}')
    if type_name in _HEADERS:
        present.stamp = ROSClock().now().to_msg()
    fields = present.get_fields_and_field_types()
    for name in value:
        here = [*path, name]
        if name not in fields:
            raise TypeError(f'{root} does not have a field {".".join(here)}')
        setattr(
            present, name, _made(value[name], fields[name], root, getattr(present, name), here)
        )
    return present
