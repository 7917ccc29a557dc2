"""Message types: which there are, and what they look like.

A type is known from a folder of .msg files or from an installed package, where the folder comes
first, as a workspace hides what lies below it. No ROS library is loaded for an installed type;
.msg files are read with the parser that comes with ROS 2. Nothing here knows a route or a format.
"""

import difflib
import re
from collections.abc import Mapping
from collections.abc import Sequence as Listed
from dataclasses import replace
from pathlib import Path
from typing import Final

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.message_types.definition import (
    Docs,
    has_parser,
    line_of,
    read_definition,
    read_docs,
)
from ros2_kafka_bridge.message_types.description import (
    DescribedTypes,
    TypeDescription,
    make_layout,
    nested_names,
    type_hash,
)
from ros2_kafka_bridge.message_types.folders import message_files
from ros2_kafka_bridge.message_types.installed import (
    installed_names,
    installed_source,
    read_installed,
    undescribed_source,
)
from ros2_kafka_bridge.message_types.layout import Layout, with_layout
from ros2_kafka_bridge.outside.extras import how_to_get_ros

INSTALLED: Final = 'is installed here'
"""The origin of what is described by its package."""

_HINTS: Final = 100


def type_names(message_path: Listed[Path] = ()) -> list[str]:
    """All message types that are known, sorted; no ROS library is loaded for it.

    Args:
        message_path: Folders of .msg files; empty asks for the installed types alone.

    Raises:
        ConfigError: A folder is not there, or holds no .msg files.
    """
    return sorted(installed_names() | message_files(message_path).keys())


def unknown_type(name: str, message_path: Listed[Path] = ()) -> str | None:
    """Say what is wrong with the name of a type and what is near it; None if it exists.

    It says, too, what is wrong with a folder.
    """
    return KnownTypes().unknown(name, message_path)


class KnownTypes:
    """Checks all names of a file: looks at the folders once, gives some hints."""

    def __init__(self) -> None:
        self._names: dict[tuple[Path, ...], list[str] | ConfigError] = {}
        self._hints_left = _HINTS

    def unknown(self, name: str, message_path: Listed[Path] = ()) -> str | None:
        """Say what is wrong with the name of a type; None if it exists."""
        known = self._known(tuple(message_path))
        if isinstance(known, ConfigError):
            return str(known)
        if name in known:
            return None
        self._hints_left -= 1
        return _problem(name, known, hints=self._hints_left >= 0)

    def mistake(self, name: str, message_path: Listed[Path] | None = ()) -> str | None:
        """Say what is wrong with the name of a type in a file; None where nothing is known to be.

        A type of a package that is not here may be described by a node that uses it.

        Args:
            name: As the file has it.
            message_path: Folders of .msg files; None where each type needs its package here.
        """
        if message_path is None:
            problem = self.unknown(name)
            return problem and f'{problem}: install its package (ros.packages is import)'
        problem = self.unknown(name, message_path)
        known = self._known(tuple(message_path))
        if problem is None or isinstance(known, ConfigError) or not known:
            return problem
        package = f'{name.partition("/")[0]}/'
        return problem if any(one.startswith(package) for one in known) else None

    def _known(self, folders: tuple[Path, ...]) -> list[str] | ConfigError:
        if folders not in self._names:
            try:
                self._names[folders] = type_names(folders)
            except ConfigError as error:
                self._names[folders] = error
        return self._names[folders]


def load_layout(name: str, message_path: Listed[Path] = ()) -> Layout:
    """What a type looks like, without its docs and constants.

    Raises:
        ConfigError: There is no such type, its .msg file has a mistake, or its package came
            without a description.
    """
    return make_layout(name, describe(name, message_path))


def describe(name: str, message_path: Listed[Path] = ()) -> DescribedTypes:
    """What ROS 2 writes down of a type and of all that it holds; no layout may come of it.

    Raises:
        ConfigError: As `load_layout`.
    """
    files = message_files(message_path)
    known = sorted(installed_names() | files.keys())
    if problem := _problem(name, known):
        raise ConfigError([problem])
    return _described(name, files, known)


def document(layout: Layout, message_path: Listed[Path] = ()) -> Layout:
    """Add the docs and constants of a type, and of all that it holds, from their .msg files.

    They take time to read, and the data path does without. They stay empty where a type came
    without its .msg file, and where there is no parser of ROS 2.

    Args:
        layout: From `load_layout`.
        message_path: As it was loaded with.

    Raises:
        ConfigError: A .msg file has a mistake.
    """
    return _documented(layout, message_files(message_path), {}) if has_parser() else layout


def _problem(name: str, known: list[str], *, hints: bool = True) -> str | None:
    if name in known:
        return None
    near = _near(name, known) if hints else None
    if near:
        hint = f' (did you mean {near}?)'
    elif known:
        hint = ''
    else:
        hint = f': no ROS 2 messages are installed: {how_to_get_ros()}'
    if not re.fullmatch(r'\w+/msg/\w+', name, re.ASCII):
        return f'{name or "an empty name"} is not of the form pkg/msg/Type{hint}'
    return f'no message type {name} here{hint}'


def _near(name: str, names: list[str]) -> str | None:
    """The type that was probably meant, also by `std_msgs.msg.string` and the like."""
    words = [word for word in re.split(r'\W+', name.lower()) if word]
    if not words:
        return None
    by_lower = {known.lower(): known for known in names}
    wanted = f'{words[0]}/msg/{words[-1]}'
    found = difflib.get_close_matches(wanted, by_lower, n=1, cutoff=0.8)
    found = found or [known for known in by_lower if known.endswith(f'/{words[-1]}')]
    return by_lower[found[0]] if found else None


def _described(name: str, files: Mapping[str, Path], known: list[str]) -> DescribedTypes:
    """The descriptions of a type and of all that it holds, from files before packages."""
    types: dict[str, TypeDescription] = {}
    hashes: dict[str, str] = {}
    origin = f'is described by {files[name]}' if name in files else INSTALLED
    is_of_files, wanted = False, [name]
    while wanted:
        one = wanted.pop()
        if one in types:
            continue
        if file := files.get(one) or undescribed_source(one):
            is_of_files = True
            types[one] = read_definition(one, file)
            _check_held(types[one], file, known)
            wanted += nested_names(types[one])
        else:
            found = read_installed(one)
            types |= {inner: it for inner, it in found.types.items() if inner not in files}
            hashes |= found.hashes
            wanted += [inner for inner in found.types if inner in files]
    if is_of_files:
        hashes = {inner: type_hash(inner, types) for inner in types}
    return DescribedTypes(types, hashes, origin)


def _check_held(description: TypeDescription, file: Path, known: list[str]) -> None:
    """Refuse a file with a field of a type that is not known."""
    for field in description.fields:
        held = field.type.nested_type_name
        if held and (problem := _problem(held, known)):
            raise ConfigError([f'{file}:{line_of(field.name, file)}: {problem}'])


def _documented(layout: Layout, files: Mapping[str, Path], made: dict[str, Layout]) -> Layout:
    name = layout.type_name
    if name not in made:
        docs = _docs(layout, files)
        fields = tuple(
            field._replace(
                kind=with_layout(field.kind, lambda held: _documented(held, files, made)),
                doc=docs.fields.get(field.name, ''),
            )
            for field in layout.fields
        )
        made[name] = replace(layout, fields=fields, constants=docs.constants, doc=docs.doc)
    return made[name]


def _docs(layout: Layout, files: Mapping[str, Path]) -> Docs:
    """What its file says; nothing where that is of another version, as a node may have one."""
    name = layout.type_name
    file = files.get(name) or installed_source(name)
    docs = read_docs(name, file) if file else Docs('', {}, ())
    is_same = docs.fields.keys() == {field.name for field in layout.fields}
    return docs if is_same else Docs('', {}, ())
