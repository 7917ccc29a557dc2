"""What `ros2-kafka-warehouse run` finds out before it starts anything."""

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from ros2_kafka_warehouse import ros_domain
from ros2_kafka_warehouse.domain.profile_files import ProfileError
from ros2_kafka_warehouse.domain.site import SiteError, make_site
from ros2_kafka_warehouse.ros_domain import claim_domain
from ros2_kafka_warehouse.run import missing_of, programs_of, write_site
from ros2_kafka_warehouse.run_options import Options, StartError, check, site_of

CLAIM = """
import pathlib, subprocess, sys
from ros2_kafka_warehouse import ros_domain
ros_domain._LOCKS = pathlib.Path(sys.argv[1])
with ros_domain.claim_domain(7):
    left = subprocess.Popen(['cat'], close_fds=False)
    print(left.pid, flush=True)
    sys.stdin.read()
    import os
    os._exit(0)
"""


@pytest.fixture(autouse=True)
def _locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ros_domain, '_LOCKS', tmp_path)


@pytest.fixture
def holder(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """A process in ROS domain 7, which has started another one that outlives it, not the test."""
    command = [sys.executable, '-c', CLAIM, str(tmp_path)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        left = int(process.stdout.readline())
        yield process
        process.kill()
        os.kill(left, 9)


def test_a_ros_domain_has_room_for_one_warehouse(holder: subprocess.Popen[str]) -> None:
    said = rf'another warehouse \(process {holder.pid}\) is in ROS domain 7: choose another'
    with pytest.raises(StartError, match=said), claim_domain(7):
        pass
    with claim_domain(8):
        pass


def test_a_warehouse_that_was_killed_leaves_its_domain_although_a_process_of_it_lives(
    holder: subprocess.Popen[str],
) -> None:
    holder.kill()
    holder.wait()
    with claim_domain(7):
        pass


def test_every_user_of_the_machine_may_lock_a_domain(tmp_path: Path) -> None:
    before = os.umask(0o077)
    try:
        with claim_domain(7):
            pass
    finally:
        os.umask(before)
    [lock] = tmp_path.iterdir()
    assert lock.stat().st_mode & 0o777 == 0o666


def test_a_port_that_is_taken_is_said_before_anything_starts() -> None:
    with socket.create_server(('127.0.0.1', 0)) as taken:
        options = Options(port=taken.getsockname()[1])
        with pytest.raises(StartError, match=r'port \d+: Address already in use: choose another'):
            check(options, site_of(options))


def test_a_host_that_is_not_ours_is_said() -> None:
    options = Options(host='no such host', port=8391)
    with pytest.raises(StartError, match='--host no such host: '):
        check(options, site_of(options))


def test_a_profile_that_is_missing_is_said_before_anything_starts() -> None:
    nowhere = Path('nowhere.yaml')
    for options in (
        Options(port=0, profiles=nowhere),
        Options(port=0, failure_profile=nowhere),
    ):
        with pytest.raises(ProfileError, match=r'nowhere\.yaml: cannot be read'):
            check(options, site_of(options))
    own = Options(port=0, profiles=nowhere, without=('execution_profiles',))
    check(own, site_of(own))


def test_a_robot_of_a_type_that_nobody_knows_is_said(tmp_path: Path) -> None:
    own = write_site(make_site(3), tmp_path)
    own.write_text(own.read_text().replace('type: hauler', 'type: hauller'))
    options = Options(site=own, port=0)
    with pytest.raises(SiteError, match=r'robots\.hauler-03\.type: .* did you mean hauler'):
        check(options, site_of(options))


def test_what_a_node_of_the_user_is_to_say_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('ROS_DOMAIN_ID', '7')
    assert missing_of(['robots'], ['monitor', 'task_organizer']) == (
        'waits for robots (you run it): a node in ROS domain 7 that publishes /robots/state; '
        'until then monitor, task_organizer cannot begin'
    )


def test_of_every_process_a_sign_of_life_is_expected(tmp_path: Path) -> None:
    programs = programs_of(Options(), tmp_path / 'site.yaml', 'k:1')
    assert [program.name for program in programs if program.alive is None] == []
    for program in programs:
        told = program.tells_as_service or str(program.alive) in program.command
        assert told, program.name
