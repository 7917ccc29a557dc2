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
)
from ros2_kafka_bridge.message_types.layout import Array, Kind, Layout, Sequence
from ros2_kafka_bridge.outside.extras import how_to_get_ros

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
    """`unknown_type` for all names of a file: looks at the folders once, gives some hints."""

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

    def _known(self, folders: tuple[Path, ...]) -> list[str] | ConfigError:
        if folders not in self._names:
            try:
                self._names[folders] = type_names(folders)
            except ConfigError as error:
                self._names[folders] = error
        return self._names[folders]


def installed_hash(name: str) -> str | None:
    """The REP-2011 hash of an installed type; None where there is none."""
    try:
        return load_layout(name).type_hash
    except ConfigError:
        return None


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
    wanted = [name]
    while wanted:
        one = wanted.pop()
        if one in types:
            continue
        if one in files:
            types[one] = read_definition(one, files[one])
            _check_held(types[one], files[one], known)
            wanted += nested_names(types[one])
        else:
            found = read_installed(one)
            types |= {inner: it for inner, it in found.types.items() if inner not in files}
            hashes |= found.hashes
            wanted += [inner for inner in found.types if inner in files]
    if types.keys() & files.keys():
        hashes = {inner: type_hash(inner, types) for inner in types}
    return DescribedTypes(types, hashes)


def _check_held(description: TypeDescription, file: Path, known: list[str]) -> None:
    """Refuse a file with a field of a type that is not known."""
    for field in description.fields:
        held = field.type.nested_type_name
        if held and (problem := _problem(held, known)):
            raise ConfigError([f'{file}:{line_of(field.name, file)}: {problem}'])


def _documented(layout: Layout, files: Mapping[str, Path], made: dict[str, Layout]) -> Layout:
    name = layout.type_name
    if name not in made:
        docs = _docs(name, files)
        fields = tuple(
            field._replace(
                kind=_documented_kind(field.kind, files, made),
                doc=docs.fields.get(field.name, ''),
            )
            for field in layout.fields
        )
        made[name] = replace(layout, fields=fields, constants=docs.constants, doc=docs.doc)
    return made[name]


def _documented_kind(kind: Kind, files: Mapping[str, Path], made: dict[str, Layout]) -> Kind:
    match kind:
        case Layout():
            return _documented(kind, files, made)
        case Array() | Sequence():
            return replace(kind, item=_documented_kind(kind.item, files, made))
        case _:
            return kind


def _docs(name: str, files: Mapping[str, Path]) -> Docs:
    file = files.get(name) or installed_source(name)
    return read_docs(name, file) if file else Docs('', {}, ())
