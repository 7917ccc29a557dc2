"""Processes of the tests that begin warm are what those are that a command starts."""

import signal
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Final

import pytest
from support.processes.harness import Process, eventually
from support.processes.warm import Warm

from rig.processes import ProcessError

SCRIPT: Final = """
import os, pathlib, signal, sys
files = [int(link.name) for link in pathlib.Path('/proc/self/fd').iterdir() if link.exists()]
print(sys.argv[1:], __name__, os.environ.get('OWN'), os.environ.get('GONE'), os.getcwd())
print([signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)])
print('for children:', [file for file in files if os.get_inheritable(file)], sys.stdin.read())
print('to standard error', file=sys.stderr)
sys.stdout.flush()
if sys.argv[1] == 'stay':
    signal.pause()
sys.exit(7)
"""


@pytest.fixture
def script(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    made = tmp_path / 'script.py'
    made.write_text(SCRIPT)
    return made


def test_it_has_the_words_environment_place_and_signals_that_a_command_gives(
    script: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    warm = partial(Process, [str(script), 'end'], begin=Warm)
    monkeypatch.setenv('GONE', 'here')
    with warm(tmp_path / 'first') as first:
        assert first.wait() == 7
    monkeypatch.delenv('GONE')
    own = {'OWN': 'x'}
    with (
        warm(tmp_path / 'warm', own) as one,
        Process([sys.executable, str(script), 'end'], tmp_path / 'cold', own) as other,
    ):
        assert (one.wait(), other.wait()) == (7, 7)
    assert one.output() == other.output()
    assert "['end'] __main__ x None" in one.output()
    assert "['end'] __main__ None here" in first.output()


def test_it_has_imported_what_a_bridge_needs_and_has_no_path_of_the_tests(tmp_path: Path) -> None:
    script = tmp_path / 'script.py'
    script.write_text('import sys; print("pytest" in sys.modules, *sys.path, *sys.modules)')
    with Process([str(script)], tmp_path / 'log', begin=Warm) as process:
        assert process.wait() == 0
    is_under_pytest, *words = process.output().split()
    assert is_under_pytest == 'False'
    assert {'rclpy.node', 'rosidl_generator_py', 'std_msgs.msg'} <= set(words)
    assert 'support.processes.warm_modules' in words
    assert {'confluent_kafka.admin', 'ros2_kafka_bridge.bridge'} <= set(words)
    assert str(Path(__file__).parents[1]) not in words


def test_it_ends_with_the_process_that_has_started_it(tmp_path: Path) -> None:
    program = (
        'import os, pathlib, sys, time; sys.path.insert(0, sys.argv[1])\n'
        'from support.processes.warm import Warm\n'
        'log = pathlib.Path(sys.argv[2], "log"); script = str(log.with_name("script.py"))\n'
        'if __name__ == "__main__":\n'
        '    process = Warm([script, "stay"], log, dict(os.environ))\n'
        '    while not log.exists() or "for children" not in log.read_text(): time.sleep(0.01)\n'
        '    print(process.pid, flush=True)\n'
        '    os.kill(os.getpid(), 9)\n'
    )
    owner = tmp_path / 'owner.py'
    owner.write_text(program)
    (tmp_path / 'script.py').write_text(SCRIPT)
    command = [sys.executable, str(owner), str(Path(__file__).parents[1]), str(tmp_path)]
    run = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
    assert run.returncode == -signal.SIGKILL
    eventually(lambda: not shown(int(run.stdout)), 30)


def shown(pid: int) -> bytes:
    command = ['ps', '-o', 'args=', '-p', str(pid)]
    return subprocess.run(command, check=False, capture_output=True).stdout


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGTERM, signal.SIGHUP])
def test_it_ends_by_a_signal(script: Path, tmp_path: Path, number: signal.Signals) -> None:
    with Process([str(script), 'stay'], tmp_path / 'log', begin=Warm) as process:
        process.wait_for('for children')
        assert process.running
        with pytest.raises(ProcessError, match='did not end'):
            process.wait(0.01)
        process.send(number)
        assert process.wait() == -number
        assert not process.running
        process.send(number)  # to nobody


def test_it_has_ended_with_its_with(script: Path, tmp_path: Path) -> None:
    with Process([str(script), 'stay'], tmp_path / 'log', begin=Warm) as process:
        assert shown(process.pid)
    eventually(lambda: not shown(process.pid), 10)
