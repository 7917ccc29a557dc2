"""Folders of .msg files: of types that are not built, or not built here."""

import os
import re
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Final
from xml.etree import ElementTree as ET

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.outside.files import UnreadableError, read_regular

_DEPTH: Final = 6
_ENTRIES_LIMIT: Final = 100_000
_FOLDERS_LIMIT: Final = 20
_IGNORED: Final = ('COLCON_IGNORE', 'AMENT_IGNORE')


def message_files(message_path: Sequence[Path]) -> dict[str, Path]:
    """The .msg file of each type in folders; an earlier folder hides a later one.

    A folder holds packages, at any depth as in the src of a workspace, or is one itself. The
    types of a package are `PACKAGE/msg/*.msg`. Its name is in its package.xml, else it is that
    of its folder. What colcon passes by is passed by here: hidden folders, and those with a
    COLCON_IGNORE, as build, install and log have.

    Raises:
        ConfigError: A folder is not there or has no such file, or has a type twice.
    """
    found: dict[str, Path] = {}
    folders = list(dict.fromkeys(message_path))
    if len(folders) > _FOLDERS_LIMIT:
        raise ConfigError([f'message path: more than {_FOLDERS_LIMIT} folders'])
    for folder in folders:
        found = _in_folder(folder) | found
    return found


def _in_folder(folder: Path) -> dict[str, Path]:
    start = folder.expanduser().absolute()
    if not os.path.isdir(start):  # noqa: PTH112 (that of a path can raise)
        raise ConfigError([f'message path {folder}: there is no such folder'])
    if start.name == 'msg':
        start = start.parent
    found: dict[str, Path] = {}
    for package in _packages(start, folder):
        name = _package_name(package)
        for file in _definitions(package / 'msg', folder):
            type_name = f'{name}/msg/{file.stem}'
            if type_name in found:
                raise ConfigError(
                    [f'message path {folder}: {type_name} is both {found[type_name]} and {file}']
                )
            found[type_name] = file
    if not found:
        raise ConfigError([f'message path {folder}: there is no PACKAGE/msg/*.msg in it'])
    return found


def _definitions(directory: Path, folder: Path) -> list[Path]:
    found = list(islice(directory.glob('*.msg'), _ENTRIES_LIMIT + 1))
    _check_number(len(found), folder)
    return sorted(found)


def _check_number(entries: int, folder: Path) -> None:
    """Refuse what is no folder of packages: a disk, a dump of files."""
    if entries > _ENTRIES_LIMIT:
        much = f'more than {_ENTRIES_LIMIT} files and folders lie in it'
        raise ConfigError([f'message path {folder}: {much}: name the folder of the packages'])


def _packages(start: Path, named: Path) -> Iterator[Path]:
    """The folders that have a folder msg, without looking into a package for another one."""
    # Packages are often links in a workspace; the depth ends what goes round in circles.
    entries = 0
    for directory, folders, files in os.walk(start, followlinks=True):
        entries += len(folders) + len(files)
        _check_number(entries, named)
        here = Path(directory)
        if 'msg' in folders:
            yield here
        depth = len(here.parts) - len(start.parts)
        if 'package.xml' in files or depth == _DEPTH:
            folders.clear()
        folders[:] = sorted(name for name in folders if name != 'msg' and _is_open(here / name))


def _is_open(folder: Path) -> bool:
    ignored = any(os.path.exists(folder / mark) for mark in _IGNORED)  # noqa: PTH110
    return not folder.name.startswith('.') and not ignored


def _package_name(package: Path) -> str:
    manifest = package / 'package.xml'
    if not os.path.isfile(manifest):  # noqa: PTH113
        return package.name
    try:
        root = ET.fromstring(read_regular(manifest))  # noqa: S314 -- the user's own
    except (UnreadableError, LookupError, ValueError, ET.ParseError) as error:
        raise ConfigError([f'{manifest}: {error}']) from error
    name = root.findtext('name', '').strip() or package.name
    if not re.fullmatch(r'[\w-]+', name, re.ASCII):
        raise ConfigError([f'{manifest}: {name!r:.60} is no name of a package'])
    return name
