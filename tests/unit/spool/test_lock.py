"""Who has a spool: the kernel knows whether somebody, the lock file says who."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from support.processes.lifetimes import ended
from support.spools.files import make, opened

from ros2_kafka_bridge.errors import SpoolInUseError
from ros2_kafka_bridge.spool.lock import holder, is_in_use, lock_of
from ros2_kafka_bridge.spool.store import file_of

_WRITER = Path(__file__).parents[2] / 'peers' / 'spool_writer.py'


def lock_in(place: Path) -> Path:
    return lock_of(file_of(place, 'bridge', 'route'))


def test_where_nobody_has_it_nobody_is_named(tmp_path: Path) -> None:
    assert holder(lock_in(tmp_path)) == (False, 0)
    with opened(tmp_path, 3):
        pass
    assert lock_in(tmp_path).exists()
    assert holder(lock_in(tmp_path)) == (False, 0)


def test_a_killed_process_has_it_no_more_though_the_file_names_it(tmp_path: Path) -> None:
    command = [sys.executable, str(_WRITER), str(tmp_path), 'no sync']
    with ended(subprocess.Popen(command, stdout=subprocess.PIPE, text=True)) as writer:
        assert writer.stdout is not None
        writer.stdout.readline()
        assert holder(lock_in(tmp_path)) == (True, writer.pid)
        writer.kill()
        writer.wait()
    assert lock_in(tmp_path).read_bytes().startswith(b'%d ' % writer.pid)
    assert holder(lock_in(tmp_path)) == (False, 0)


@pytest.mark.parametrize('name', [b'17 4026539999    ', b'17              ', b'no number at all'])
def test_a_number_that_does_not_count_here_is_not_told(tmp_path: Path, name: bytes) -> None:
    """In another container it is that of another process, or of none."""
    with opened(tmp_path):
        with lock_in(tmp_path).open('r+b') as file:
            file.write(name)
        assert is_in_use(lock_in(tmp_path))
        assert holder(lock_in(tmp_path)) == (True, None)
        with pytest.raises(SpoolInUseError, match=r'another process uses this spool \(pid unkn'):
            make(tmp_path).open()


def test_of_a_lock_file_that_cannot_be_read_nobody_is_known(tmp_path: Path) -> None:
    with opened(tmp_path):
        lock_in(tmp_path).unlink()
        lock_in(tmp_path).symlink_to(lock_in(tmp_path))  # also root cannot read it
        assert holder(lock_in(tmp_path)) == (None, None)
        assert not is_in_use(lock_in(tmp_path))


def test_to_look_takes_it_from_nobody(tmp_path: Path) -> None:
    with opened(tmp_path):
        for _ in range(100):
            assert holder(lock_in(tmp_path)) == (True, os.getpid())
