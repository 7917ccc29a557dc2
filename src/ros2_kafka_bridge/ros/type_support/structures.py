"""The C structures in which ROS 2 tells its middleware what a message type is.

Those of the headers of Jazzy and of Kilted, which are the same:
rosidl_runtime_c/message_type_support_struct.h, type_hash.h and type_description/*__struct.h,
rosidl_typesupport_fastrtps_cpp/message_type_support.h,
rosidl_typesupport_introspection_c/message_introspection.h. What is assigned to a field is kept
alive by the structure, also what it points to.
"""

from ctypes import (
    CFUNCTYPE,
    POINTER,
    Structure,
    c_bool,
    c_char_p,
    c_size_t,
    c_uint8,
    c_uint32,
    c_uint64,
    c_void_p,
)
from typing import Final

FindSupport: Final = CFUNCTYPE(c_void_p, c_void_p, c_char_p)
"""(type support, identifier of an implementation) -> the type support for it, or NULL."""

Get: Final = CFUNCTYPE(c_void_p, c_void_p)
"""(type support) -> its hash, description or sources."""

_SPARE: Final = c_void_p * 16  # what a newer ROS may read behind the end is NULL


class TypeSupport(Structure):
    """A `rosidl_message_type_support_t`."""

    _fields_ = (
        ('identifier', c_void_p),  # compared as a pointer by some of rmw_fastrtps
        ('data', c_void_p),
        ('find', FindSupport),
        ('get_hash', Get),
        ('get_description', Get),
        ('get_sources', Get),
        ('spare', _SPARE),
    )


class TypeHash(Structure):
    """A `rosidl_type_hash_t`."""

    _fields_ = (('version', c_uint8), ('value', c_uint8 * 32))


class FastddsType(Structure):
    """A `message_type_support_callbacks_t`: what rmw_fastrtps_cpp has of a type."""

    _fields_ = (
        ('namespace', c_char_p),
        ('name', c_char_p),
        ('serialize', c_void_p),
        ('deserialize', c_void_p),
        ('get_size', c_void_p),
        ('get_largest_size', c_void_p),
        ('key', c_void_p),
        ('spare', _SPARE),
    )


class IntrospectedField(Structure):
    """A `rosidl_typesupport_introspection_c__MessageMember`: a field of a type."""

    _fields_ = (
        ('name', c_char_p),
        ('type_id', c_uint8),
        ('string_bound', c_size_t),
        ('held', POINTER(TypeSupport)),
        ('is_key', c_bool),
        ('is_list', c_bool),
        ('length', c_size_t),
        ('is_bounded', c_bool),
        ('offset', c_uint32),
        ('default', c_void_p),
        ('functions', c_void_p * 6),
    )


class IntrospectedType(Structure):
    """A `rosidl_typesupport_introspection_c__MessageMembers`: the fields of a type."""

    _fields_ = (
        ('namespace', c_char_p),
        ('name', c_char_p),
        ('number', c_uint32),
        ('size', c_size_t),
        ('has_key', c_bool),
        ('members', POINTER(IntrospectedField)),
        ('initialize', c_void_p),
        ('finalize', c_void_p),
        ('spare', _SPARE),
    )


class Text(Structure):
    """A `rosidl_runtime_c__String`; `capacity` counts the NUL behind it."""

    _fields_ = (('data', c_char_p), ('size', c_size_t), ('capacity', c_size_t))


class FieldKind(Structure):
    """A `rosidl_runtime_c__type_description__FieldType`."""

    _fields_ = (
        ('type_id', c_uint8),
        ('capacity', c_uint64),
        ('string_capacity', c_uint64),
        ('held', Text),
    )


class DescribedField(Structure):
    """A `rosidl_runtime_c__type_description__Field`."""

    _fields_ = (('name', Text), ('kind', FieldKind), ('default', Text))


class DescribedFields(Structure):
    """A `rosidl_runtime_c__type_description__Field__Sequence`."""

    _fields_ = (('data', POINTER(DescribedField)), ('size', c_size_t), ('capacity', c_size_t))


class DescribedType(Structure):
    """A `rosidl_runtime_c__type_description__IndividualTypeDescription`."""

    _fields_ = (('name', Text), ('fields', DescribedFields))


class HeldTypes(Structure):
    """A `rosidl_runtime_c__type_description__IndividualTypeDescription__Sequence`."""

    _fields_ = (('data', POINTER(DescribedType)), ('size', c_size_t), ('capacity', c_size_t))


class Description(Structure):
    """A `rosidl_runtime_c__type_description__TypeDescription`."""

    _fields_ = (('described', DescribedType), ('held', HeldTypes))


class Sources(Structure):
    """An empty `rosidl_runtime_c__type_description__TypeSource__Sequence`."""

    _fields_ = (('data', c_void_p), ('size', c_size_t), ('capacity', c_size_t))
