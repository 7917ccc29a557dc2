"""Folders of .msg files: of types that are not built, or not built here."""

import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final
from xml.etree import ElementTree as ET

from ros2_kafka_bridge.errors import ConfigError

_DEPTH: Final = 6
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
    for folder in message_path:
        found = _in_folder(folder) | found
    return found


def _in_folder(folder: Path) -> dict[str, Path]:
    start = folder.expanduser().absolute()
    if not start.is_dir():
        raise ConfigError([f'message path {folder}: there is no such folder'])
    if start.name == 'msg':
        start = start.parent
    found: dict[str, Path] = {}
    for package in _packages(start):
        name = _package_name(package)
        for file in sorted((package / 'msg').glob('*.msg')):
            type_name = f'{name}/msg/{file.stem}'
            if type_name in found:
                raise ConfigError(
                    [f'message path {folder}: {type_name} is both {found[type_name]} and {file}']
                )
            found[type_name] = file
    if not found:
        raise ConfigError([f'message path {folder}: there is no PACKAGE/msg/*.msg in it'])
    return found


def _packages(start: Path) -> Iterator[Path]:
    """The folders that have a folder msg, without looking into a package for another one."""
    # Packages are often links in a workspace; the depth ends what goes round in circles.
    for directory, folders, files in os.walk(start, followlinks=True):
        here = Path(directory)
        if 'msg' in folders:
            yield here
        depth = len(here.parts) - len(start.parts)
        if 'package.xml' in files or depth == _DEPTH:
            folders.clear()
        folders[:] = sorted(name for name in folders if name != 'msg' and _is_open(here / name))


def _is_open(folder: Path) -> bool:
    ignored = any((folder / mark).exists() for mark in _IGNORED)
    return not folder.name.startswith('.') and not ignored


def _package_name(package: Path) -> str:
    manifest = package / 'package.xml'
    if not manifest.is_file():
        return package.name
    try:
        name = ET.parse(manifest).findtext('name', '')  # noqa: S314 -- the user's own
    except (OSError, LookupError, ValueError, ET.ParseError) as error:
        raise ConfigError([f'{manifest}: {error}']) from error
    name = name.strip() or package.name
    if not re.fullmatch(r'[\w-]+', name, re.ASCII):
        raise ConfigError([f'{manifest}: {name!r:.60} is no name of a package'])
    return name
