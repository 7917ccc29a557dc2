"""Message types of installed packages: of a sourced ROS 2, of wheels, of a built workspace."""

import os
import re
import sys
import sysconfig
from pathlib import Path
from typing import Final

import msgspec

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.message_types.description import (
    DescribedTypes,
    TypeDescription,
    nested_names,
)


class _Descriptions(msgspec.Struct):
    type_description: TypeDescription
    referenced_type_descriptions: tuple[TypeDescription, ...]


class _Hash(msgspec.Struct):
    type_name: str
    hash_string: str


class _File(msgspec.Struct):
    """A .json file of rosidl_generator_type_description."""

    type_description_msg: _Descriptions
    type_hashes: tuple[_Hash, ...]


_MESSAGE: Final = re.compile(r'(msg/\w{1,200})\.\w+', re.ASCII)
# Made once, here: msgspec looks at a struct when the first decoder of it is made, and two threads
# that do so at the same time end the process (SIGSEGV). Each route loads its type in its thread.
_FILE: Final = msgspec.json.Decoder(_File)


def installed_names() -> set[str]:
    """All message types of the installed packages, without those of services and actions.

    A package whose list cannot be read, as one that is half removed, has none.
    """
    index = 'share/ament_index/resource_index/rosidl_interfaces'
    packages = [file for prefix in _prefixes() for file in (prefix / index).glob('[!.]*')]
    return {
        f'{package.name}/{found[1]}'
        for package in packages
        for line in _read(package).split()
        if (found := _MESSAGE.fullmatch(line))
    }


def _read(package: Path) -> str:
    try:
        return package.read_text(encoding='utf-8')
    except (OSError, UnicodeDecodeError):
        return ''


def read_installed(name: str) -> DescribedTypes:
    """The description of a type with those of all that it holds.

    Raises:
        ConfigError: The package came without a description, or with a broken one.
    """
    file = _find(name, '.json')
    if file is None:
        problem = f'{name} is installed without its description, share/{name}.json'
        raise ConfigError([f'{problem}: build its package with ROS 2 Iron or a newer one'])
    try:
        read = _FILE.decode(file.read_bytes())
    except (OSError, RecursionError, msgspec.DecodeError) as error:
        raise ConfigError([f'{file}: no description of a message type: {error}']) from error
    message = read.type_description_msg
    every = (message.type_description, *message.referenced_type_descriptions)
    types = {one.type_name: one for one in every}
    held = {inner for one in every for inner in nested_names(one)}
    if missing := sorted({name, *held} - types.keys()):
        raise ConfigError([f'{file}: no description of {", ".join(missing)} in it'])
    return DescribedTypes(types, {one.type_name: one.hash_string for one in read.type_hashes})


def installed_source(name: str) -> Path | None:
    """The .msg file of an installed type; None where it has only a .idl file."""
    return _find(name, '.msg')


def _prefixes() -> list[Path]:
    """Where ROS packages lie: a sourced ROS 2 first; wheels put share/ beside Python's lib/."""
    sourced = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    wheels = [sys.prefix, sysconfig.get_path('data')]
    return [Path(prefix) for prefix in dict.fromkeys(sourced + wheels) if prefix]


def _find(name: str, suffix: str) -> Path | None:
    files = (prefix / 'share' / f'{name}{suffix}' for prefix in _prefixes())
    return next((file for file in files if os.access(file, os.R_OK) and file.is_file()), None)
