"""The type supports of packages that are imported."""

import ctypes
from importlib import import_module
from typing import Any, Final

from ros2_kafka_bridge.ros.type_support.structures import TypeSupport

FASTDDS: Final = 'rosidl_typesupport_fastrtps_c'
INTROSPECTION: Final = 'rosidl_typesupport_introspection_c'


def find_class(name: str) -> Any:
    """Import a message class."""
    package, _, short = name.split('/')
    return getattr(import_module(f'{package}.msg'), short)


def message_class(name: str) -> Any:
    """Import a message class, and its type support, of a package that rclpy needs itself."""
    found = find_class(name)
    found.__import_type_support__()
    return found


def support_of(one: Any, implementation: str = '') -> TypeSupport:
    """What a class gives to rclpy, and what rmw_fastrtps_cpp finds there.

    Args:
        one: A message class, or what is made to be one.
        implementation: Of which the type support is asked for; else the first one.

    Raises:
        LookupError: It has none.
    """
    get = ctypes.pythonapi.PyCapsule_GetPointer
    get.restype = ctypes.c_void_p
    get.argtypes = (ctypes.py_object, ctypes.c_char_p)
    first = TypeSupport.from_address(get(one._TYPE_SUPPORT, None))  # noqa: SLF001 (as rclpy asks)
    if not implementation:
        return first
    address = first.find(ctypes.addressof(first), implementation.encode())
    if not address:
        raise LookupError(f'there is no {implementation}')
    return TypeSupport.from_address(address)
