"""The usual way: rclpy's message object, a dict by its fields, and the json of Python.

It takes the steps of ROS's own `rosidl_runtime_py` (`message_to_ordereddict` and
`set_message_fields`), which is what most Python bridges call, with their checks, their copies
and their questions to each value.
"""

import array
import copy
import importlib
import json
from collections import OrderedDict
from collections.abc import Callable
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message
from rosidl_parser.definition import AbstractNestedType, NamespacedType


def make_to_record(python_class: type[Any]) -> Callable[[bytes], bytes]:
    """Make the function from CDR bytes to JSON."""

    def to_record(cdr: bytes) -> bytes:
        return json.dumps(_fields(deserialize_message(cdr, python_class))).encode()

    return to_record


def make_to_message(python_class: type[Any]) -> Callable[[bytes], bytes]:
    """Make the function from JSON to CDR bytes."""

    def to_message(record: bytes) -> bytes:
        message = python_class()
        _set_fields(message, json.loads(record))
        return bytes(serialize_message(message))

    return to_message


def _fields(message: Any) -> OrderedDict[str, Any]:
    fields: OrderedDict[str, Any] = OrderedDict()
    for name, _ in zip(
        message.get_fields_and_field_types().keys(), message.SLOT_TYPES, strict=True
    ):
        fields[name] = _plain(getattr(message, name, None))
    return fields


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return ''.join([chr(byte) for byte in value])
    if isinstance(value, str):
        return value
    if isinstance(value, (list, tuple, array.array, np.ndarray)):
        kind = tuple if isinstance(value, tuple) else list
        return kind([_plain(item) for item in value])
    if isinstance(value, np.number):
        return value.item()
    if not isinstance(value, (bool, float, int)):
        return _fields(value)
    return value


def _set_fields(message: Any, values: dict[str, Any]) -> None:
    for name, value in copy.deepcopy(values).items():
        present = getattr(message, name)
        made = _of_kind(present, value)
        slots = OrderedDict(
            zip([slot[1:] for slot in message.__slots__], message.SLOT_TYPES, strict=False)
        )
        slot = slots[name]
        if isinstance(slot, AbstractNestedType) and isinstance(slot.value_type, NamespacedType):
            python_class = _class_of(slot.value_type)
            for number in range(len(made)):
                inner = python_class()
                _set_fields(inner, made[number])
                made[number] = inner
        setattr(message, name, made)


def _of_kind(present: Any, value: Any) -> Any:
    kind = type(present)
    if kind is array.array:
        return kind(present.typecode, value)
    if kind is np.ndarray:
        return np.array(value, dtype=present.dtype)
    if type(value) is kind:
        return value
    try:
        return kind(value)
    except TypeError:
        made = kind()
        _set_fields(made, value)
        return made


def _class_of(named: NamespacedType) -> Any:
    module = importlib.import_module('.'.join(named.namespaces))
    return getattr(module, named.name)
