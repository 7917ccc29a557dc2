"""`depth` as a user starts it; what it says of files: tests/unit/commands/test_depth.py."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from support.processes.terminal import finished

from ros2_kafka_bridge.outside.extras import install_command

if TYPE_CHECKING:
    import subprocess

PROGRAM = 'from ros2_kafka_bridge.cli import main; main()'


def depth(place: Path, before: str = '') -> 'subprocess.CompletedProcess[str]':
    """Have it drawn which depth a reader needs that is busy for half of the time."""
    arrivals, picture = place / 'arrivals', place / 'depth.png'
    arrivals.write_text('\n'.join(str(number * 1_000_000) for number in range(2000)))
    given: list[str | Path] = [
        '--arrivals',
        arrivals,
        '--service',
        '0.5ms',
        '--loss',
        '0.01',
        '--plot',
        picture,
    ]
    return finished([sys.executable, '-c', before + PROGRAM, 'depth', *given])


def test_it_names_a_depth_and_draws_without_a_screen(tmp_path: Path) -> None:
    done = depth(tmp_path)
    assert (done.returncode, done.stderr) == (0, '')
    assert 'Recommended: KEEP_LAST, depth 1\n' in done.stdout
    assert (tmp_path / 'depth.png').stat().st_size > 10_000


@pytest.mark.parametrize('library', ['scipy', 'matplotlib'])
def test_without_the_extra_a_sentence_says_how_to_get_it(tmp_path: Path, library: str) -> None:
    done = depth(tmp_path, f'import sys; sys.modules[{library!r}] = None;')
    assert done.returncode == 2
    said = f'depth needs {library}, which is not installed: {install_command("depth")}\n'
    assert done.stderr == said
