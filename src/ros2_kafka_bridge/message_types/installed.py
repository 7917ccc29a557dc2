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


_INDEX: Final = 'share/ament_index/resource_index/rosidl_interfaces'
_MESSAGE: Final = re.compile(r'(msg/\w{1,200})\.\w+', re.ASCII)
_KEY: Final = re.compile(r'@key\b')
# Of a .idl file: the comments of a .msg file are texts there.
_TEXTS: Final = re.compile(r'"(?:\\.|[^"\\])*"|//.*|/\*(?:.|\n)*?\*/')
_VERSION: Final = re.compile(r'<version[^>]*>\s*(\d+(?:\.\d+)*)', re.ASCII)
# Made once, here: msgspec looks at a struct when the first decoder of it is made, and two threads
# that do so at the same time end the process (SIGSEGV). Each route loads its type in its thread.
_FILE: Final = msgspec.json.Decoder(_File)


def installed_names() -> set[str]:
    """All message types of the installed packages, without those of services and actions.

    A package whose list cannot be read, as one that is half removed, has none.
    """
    packages = [file for prefix in _prefixes() for file in (prefix / _INDEX).glob('[!.]*')]
    return {
        f'{package.name}/{found[1]}'
        for package in packages
        for line in _read(package).split()
        if (found := _MESSAGE.fullmatch(line))
    }


def _read(file: Path) -> str:
    """Its text, empty where it cannot be read."""
    try:
        return file.read_text(encoding='utf-8')
    except (OSError, UnicodeDecodeError):
        return ''


def read_installed(name: str) -> DescribedTypes:
    """The description of a type with those of all that it holds.

    Raises:
        ConfigError: The package came without a description, or with a broken one.
    """
    file = _find(name, '.json')
    if file is None:
        problem = f'{name} is installed, and neither share/{name}.json nor .msg can be read'
        raise ConfigError(
            [f'{problem}: build its package with ROS 2 Iron or a newer one, or let them be read']
        )
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


def undescribed_source(name: str) -> Path | None:
    """The .msg file of an installed type that came without a description, as before Iron."""
    return None if _find(name, '.json') else installed_source(name)


def has_key(name: str) -> bool:
    """Whether fields of an installed type are a DDS key, which its description does not tell."""
    file = _find(name, '.idl')
    return file is not None and _KEY.search(_TEXTS.sub('', _read(file))) is not None


def package_version(package: str) -> str:
    """The version of an installed ROS package, empty where nothing tells it."""
    file = _find(f'{package}/package', '.xml')
    found = _VERSION.search(_read(file)) if file else None
    return found[1] if found else ''


def _prefixes() -> list[Path]:
    """Where ROS packages lie: a sourced ROS 2 first; wheels put share/ beside Python's lib/."""
    sourced = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    wheels = [sys.prefix, sysconfig.get_path('data')]
    return [Path(prefix) for prefix in dict.fromkeys(sourced + wheels) if prefix]


def _find(name: str, suffix: str) -> Path | None:
    """A file of the first prefix that has the type: another one may define it otherwise."""
    package = name.partition('/')[0]
    all_prefixes = _prefixes()
    having = [prefix for prefix in all_prefixes if _lists(prefix / _INDEX / package, name)]
    files = (prefix / 'share' / f'{name}{suffix}' for prefix in having[:1] or all_prefixes)
    return next((file for file in files if os.access(file, os.R_OK) and file.is_file()), None)


def _lists(index: Path, name: str) -> bool:
    """Whether the list of a package has a type."""
    wanted = name.partition('/')[2]
    return any(line.rpartition('.')[0] == wanted for line in _read(index).split())
