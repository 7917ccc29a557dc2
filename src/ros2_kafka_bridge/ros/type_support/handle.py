"""What rclpy asks a message class for, made of a description alone.

The bytes of a message pass unread, so nothing here reads or writes one.

rmw_fastrtps calls what is made here while it holds the lock of all endpoints of a node. Nothing
that it calls may run bytecode: Python could let another thread go on there, which waits for that
lock and lets no thread go on. So it calls C alone: functions of ROS, `dict.get`, and a cache that
has the answers.
"""

import ctypes
import threading
from collections import defaultdict
from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Any, Final

from ros2_kafka_bridge.message_types.description import (
    FieldDescription,
    Ids,
    Lists,
    TypeDescription,
    held_names,
    type_hash,
)
from ros2_kafka_bridge.ros.type_support import descriptions
from ros2_kafka_bridge.ros.type_support.loaded import (
    FASTDDS,
    INTROSPECTION,
    message_class,
    support_of,
)
from ros2_kafka_bridge.ros.type_support.structures import (
    Description,
    FastddsType,
    FindSupport,
    Get,
    IntrospectedField,
    IntrospectedType,
    Sources,
    TypeHash,
    TypeSupport,
)

_DYNAMIC: Final = b'rosidl_dynamic_typesupport_c'  # asked for first: there is none
_UNBOUNDED: Final = 'rcl_interfaces/msg/ParameterEvent'  # which every node has loaded
# What rclpy looks for at a message class; for bytes it uses the first alone.
_ASKED: Final = (
    '_TYPE_SUPPORT',
    '_CREATE_ROS_MESSAGE',
    '_CONVERT_FROM_PY',
    '_CONVERT_TO_PY',
    '_DESTROY_ROS_MESSAGE',
)
_RIHS_VERSION: Final = 1
_ONE_AT_A_TIME: Final = threading.Lock()
# Of rosidl_typesupport_introspection_c/field_types.h.
_MEMBER_IDS: Final[Mapping[int, int]] = MappingProxyType(
    {
        Ids.FLOAT32: 1,
        Ids.FLOAT64: 2,
        Ids.BOOL: 6,
        Ids.BYTE: 7,
        Ids.UINT8: 8,
        Ids.INT8: 9,
        Ids.UINT16: 10,
        Ids.INT16: 11,
        Ids.UINT32: 12,
        Ids.INT32: 13,
        Ids.UINT64: 14,
        Ids.INT64: 15,
        Ids.STRING: 16,
        Ids.WSTRING: 17,
        Ids.NESTED: 18,
        Ids.BOUNDED_STRING: 16,
        Ids.BOUNDED_WSTRING: 17,
    }
)


def endpoint_class(name: str, types: Mapping[str, TypeDescription]) -> type[Any]:
    """Make what `create_publisher` and `create_subscription` take instead of a message class.

    Endpoints of it carry bytes only. The same type gives the same class, in every thread, and it
    stays: the middleware keeps pointers into it, also for later endpoints of that type.

    Args:
        name: As `std_msgs/msg/String`.
        types: At least that type and all that it holds, such as have a layout.

    Raises:
        OSError: A library of ROS is not loaded, and cannot be found.
    """
    described = tuple(types[one] for one in (name, *held_names(name, types)))
    with _ONE_AT_A_TIME:
        return _made(described)


@cache
def _made(described: tuple[TypeDescription, ...]) -> type[Any]:
    name = described[0].type_name
    support = _Supports(name, {one.type_name: one for one in described}).of_endpoint()
    new = ctypes.pythonapi.PyCapsule_New
    new.restype = ctypes.py_object
    new.argtypes = (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)
    capsule = new(ctypes.addressof(support), None, None)  # without a name, as in a package
    members = dict.fromkeys(_ASKED, capsule) | {'support': support}
    metaclass = type('EndpointType', (type,), members)
    made: type[Any] = metaclass(name.rpartition('/')[2], (), {})
    return made


class _Supports:
    """Fills the structures of a type and of all that it holds.

    Args:
        name: Of the type.
        types: The type and all that it holds.
    """

    def __init__(self, name: str, types: Mapping[str, TypeDescription]) -> None:
        self._name = name
        self._types = types
        # Of what a type holds nobody asks it, and all together they would grow by the square.
        self._descriptions = defaultdict(Description, {name: descriptions.fill(name, types)})
        self._introspected: dict[str, TypeSupport] = {}

    def of_endpoint(self) -> TypeSupport:
        """What rmw_fastrtps_cpp makes endpoints of; it keeps all that it points to."""
        name = self._name
        package, kind, short = name.split('/')
        fastdds = FastddsType(
            namespace=f'{package}::{kind}'.encode(),
            name=short.encode(),
            get_largest_size=_size_without_bound(),
        )
        support = self._support(name, FASTDDS, fastdds)
        address = ctypes.addressof(support)
        supports = {FASTDDS: support, INTROSPECTION: self._introspection(name)}
        addresses = {one.encode(): ctypes.addressof(it) for one, it in supports.items()}

        @cache
        def find(_support: int, identifier: bytes) -> int:
            return addresses.get(identifier, 0)

        for asked in (*addresses, _DYNAMIC):
            find(address, asked)
        support.find = FindSupport(find)
        support.kept = (*support.kept, self)
        return support

    def _introspection(self, name: str) -> TypeSupport:
        """What Fast DDS makes its own description of; that of Jazzy takes no type without one."""
        if name in self._introspected:
            return self._introspected[name]
        package, kind, short = name.split('/')
        fields = self._types[name].fields
        members = IntrospectedType(
            namespace=f'{package}__{kind}'.encode(),
            name=short.encode(),
            number=len(fields),
            members=(IntrospectedField * len(fields))(*map(self._member, fields)),
        )
        support = self._support(name, INTROSPECTION, members)
        runtime = ctypes.CDLL('librosidl_runtime_c.so')
        support.find = FindSupport(('get_message_typesupport_handle_function', runtime))
        self._introspected[name] = support
        return support

    def _member(self, field: FieldDescription) -> IntrospectedField:
        lists, base = divmod(field.type.type_id, Lists.ARRAY)
        held = field.type.nested_type_name
        return IntrospectedField(
            name=field.name.encode(),
            type_id=_MEMBER_IDS[base],
            string_bound=field.type.string_capacity,
            held=ctypes.pointer(self._introspection(held)) if held else None,
            is_list=lists > 0,
            length=field.type.capacity,
            is_bounded=lists * Lists.ARRAY == Lists.BOUNDED_SEQUENCE,
        )

    def _support(self, name: str, implementation: str, data: ctypes.Structure) -> TypeSupport:
        support = TypeSupport(
            identifier=_identifier(implementation),
            data=ctypes.cast(ctypes.pointer(data), ctypes.c_void_p),
        )
        digest = bytes.fromhex(type_hash(name, self._types).partition('_')[2])
        hashed = TypeHash(_RIHS_VERSION, (ctypes.c_uint8 * len(digest))(*digest))
        described, sources = self._descriptions[name], Sources()
        support.kept = (hashed, described, sources)
        support.get_hash, support.get_description, support.get_sources = (
            Get({ctypes.addressof(support): ctypes.addressof(one)}.get) for one in support.kept
        )
        return support


def _size_without_bound() -> int | None:
    """The function of a type that is unbounded: one with a bound could be shared in memory."""
    fastdds = support_of(message_class(_UNBOUNDED), FASTDDS)
    address: int | None = FastddsType.from_address(fastdds.data).get_largest_size
    return address


def _identifier(implementation: str) -> int | None:
    """Rmw_fastrtps compares some of them as pointers, so it has to be the one of the library."""
    library = ctypes.CDLL(f'lib{implementation}.so')
    return ctypes.c_void_p.in_dll(library, f'{implementation}__identifier').value
