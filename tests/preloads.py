"""Libraries that stand before those of a process (LD_PRELOAD), made of tests/peers/*.c."""

import shutil
from pathlib import Path
from typing import Final

import pytest
from command_line import finished

_SOURCES: Final = Path(__file__).parent / 'peers'


def library(name: str, place: Path) -> str:
    """Compile a library into `place`; returns its path, for LD_PRELOAD.

    Args:
        name: Of its source, without `.c`.
        place: A directory.
    """
    compiler = shutil.which('cc')
    if compiler is None:
        pytest.skip('there is no C compiler: apt-get install gcc libc6-dev')
    made = place / f'{name}.so'
    done = finished(
        [compiler, '-O2', '-shared', '-fPIC', '-o', made, _SOURCES / f'{name}.c', '-ldl']
    )
    assert done.returncode == 0, done.stderr
    return str(made)
