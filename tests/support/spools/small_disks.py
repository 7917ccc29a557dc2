"""A small file system of its own, so that it can be full; it takes root."""

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from support.processes.terminal import finished


@contextmanager
def mounted(place: Path, size: str) -> Iterator[Path]:
    """Mount a small disk in a new directory, for as long as this lasts; else skip the test."""
    place.mkdir()
    mount = ['mount', '-t', 'tmpfs', '-o', f'size={size}', 'tmpfs', str(place)]
    done = finished(mount)
    if done.returncode:
        pytest.skip(f'a small disk cannot be mounted here: {done.stderr.strip()}')
    try:
        yield place
    finally:
        subprocess.run(['umount', '--lazy', str(place)], check=True)


def fill(place: Path) -> Path:
    """Take the last byte of a disk; returns the file to be deleted for room."""
    ballast = place / 'ballast'
    with ballast.open('wb', buffering=0) as file:
        for size in (65536, 4096, 512, 1):
            try:
                while file.write(b'x' * size) == size:
                    pass
            except OSError:
                continue
    return ballast
