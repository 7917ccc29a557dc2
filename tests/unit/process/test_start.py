"""What a bridge begins as, until it has become the process that runs."""

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Final, cast

import pytest

from ros2_kafka_bridge.config.file import loads
from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.process import start
from ros2_kafka_bridge.process.plan import plan_of

if TYPE_CHECKING:
    from ros2_kafka_bridge.process.signals import Signals

TEXT: Final = """\
name: b
kafka: {bootstrap.servers: x}
routes:
  - {name: a, from: {ros: /a}, to: {kafka: a}, format: cdr}
"""


@pytest.mark.parametrize('module', ['start', 'worker'])
def test_a_stop_in_the_start_is_one_whatever_library_it_meets(module: str) -> None:
    """Some pass over any exception of what they call."""
    code = (
        f'from ros2_kafka_bridge.process.{module} import _end\n'
        'try:\n    _end(15)\nexcept BaseException:\n    pass\n'
        'print("goes on")\n'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, check=False)
    assert (done.returncode, done.stdout) == (0, b'')


@pytest.mark.parametrize(('had', 'means'), [('True', 'stop'), ('False', 'reload')])
def test_a_terminal_that_was_closed_in_the_start_is_known_to_the_process_that_runs(
    had: str, means: str
) -> None:
    """Its shell has said so while it was there still: what runs now never saw it."""
    code = (
        'import os, signal, sys\n'
        'from ros2_kafka_bridge.process.signals import Signals\n'
        f'it = Signals(lambda _: print("stop"), had_terminal={had})\n'
        'it.install()\n'
        'os.kill(os.getpid(), signal.SIGHUP)\n'
        'if it.take_reload(): print("reload")\n'
    )
    done = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, check=False, start_new_session=True
    )
    assert done.stdout.decode() == f'{means}\n', done.stderr


def test_a_bridge_that_has_a_terminal_says_so_to_what_it_becomes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    became: list[list[str]] = []
    monkeypatch.setattr(start, 'become', lambda _, words: became.append(words))
    monkeypatch.setattr('signal.pthread_sigmask', lambda *_: None)
    file = tmp_path / 'bridge.yaml'
    file.write_text(TEXT)
    plan = plan_of(loads(TEXT, str(file), {}), file)
    for had_terminal in (True, False):
        signals = SimpleNamespace(had_terminal=had_terminal, take_reload=lambda: False)
        start._become(plan, start._parse([str(file)]), cast('Signals', signals))
    for words in became:
        os.close(int(next(w for w in words if w.startswith('--plan=')).removeprefix('--plan=')))
    assert ['--terminal' in words for words in became] == [True, False]


def test_a_path_that_is_no_text_is_told_in_a_sentence(tmp_path: Path) -> None:
    file = Path(os.fsdecode(os.fsencode(tmp_path) + b'/caf\xe9.yaml'))
    file.write_text(TEXT)
    with pytest.raises(ConfigError, match='its path is not UTF-8: rename it'):
        start._plan(file, '')
