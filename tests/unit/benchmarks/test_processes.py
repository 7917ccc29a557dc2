"""The processes that tests and benchmarks start."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest
from support.bridges.workers import gone
from support.patience import eventually

from rig.processes import Begin, ProcessError, Programs, direct, owned

SAYS = 'import os, sys, time; print(os.environ["WORD"], *sys.argv[1:], flush=True); time.sleep(60)'

OWNER = """
import os, pathlib, sys
from rig.processes import Programs
process = Programs(pathlib.Path(sys.argv[1]), {}).python('it', '-c', 'import time; time.sleep(60)')
process.start()
print(process.pid, flush=True)
os.kill(os.getpid(), 9)
"""


@pytest.mark.parametrize('begin', [owned, direct])
def test_a_process_can_be_killed_and_started_again_in_one_log(
    tmp_path: Path, begin: Begin
) -> None:
    with Programs(tmp_path, {'WORD': 'here'}, begin=begin).python('it', '-c', SAYS) as process:
        process.wait_for('here')
        process.kill()
        process.check()  # it is no fault of its own
        assert process.status == -signal.SIGKILL
        process.start('again')
        process.wait_for('here again')
        assert process.end() == -signal.SIGTERM
        process.check()
    assert process.output() == 'here\nhere again\n'


def test_a_process_that_ends_by_itself_is_told_at_once_with_its_last_words(tmp_path: Path) -> None:
    process = Programs(tmp_path, {}).python('it', '-c', 'import sys; sys.exit("no Kafka")')
    with process:
        with pytest.raises(ProcessError, match='ended with status 1\n    no Kafka'):
            process.wait_for('ready', 1000)
        with pytest.raises(ProcessError, match='it ended with status 1\n    no Kafka'):
            process.check()


def test_a_test_that_fails_shows_what_its_processes_said_and_where_they_stand(
    tmp_path: Path,
) -> None:
    code = f'def hang(): {SAYS}\nhang()'
    process = Programs(tmp_path, {'WORD': 'here'}).python('it', '-X', 'faulthandler', '-c', code)
    process.start()
    process.wait_for('here')
    with pytest.raises(ValueError, match='wrong') as told, process:
        raise ValueError('wrong')
    said, stands = told.value.__notes__
    assert said.endswith('runs\n    here')
    assert stands.startswith('it stands\n')
    assert ' in hang\n' in stands
    assert process.status == -signal.SIGABRT


def test_a_process_does_not_outlive_one_that_is_killed(tmp_path: Path) -> None:
    command = [sys.executable, '-c', OWNER, str(tmp_path)]
    owner = subprocess.run(command, stdout=subprocess.PIPE, check=False)
    assert owner.returncode == -signal.SIGKILL
    eventually(lambda: gone(int(owner.stdout)), 30)
