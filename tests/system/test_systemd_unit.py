"""The unit file in a real systemd, with its mounts and limits: two bridges, a record both ways."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from support.bridges.routes import to_kafka, to_ros
from support.install.booted import REPOSITORY, Machine, booted
from support.processes.harness import Bench, eventually

PAGE = REPOSITORY / 'docs/systemd.md'
FILES = '/etc/ros2-kafka-bridge'
SPOOL = {'path': '/var/lib/ros2-kafka-bridge'}
_RELOADS_BY_NOTIFY = 253


@pytest.fixture
def machine(tmp_path: Path) -> Iterator[Machine]:
    with booted(tmp_path / 'machine') as found:
        yield found


def test_the_unit_carries_both_ways_is_restarted_reloads_and_stops(
    bench: Bench, topic_name: str, machine: Machine
) -> None:
    back = f'{topic_name}.back'
    bench.create_topic(topic_name, back)
    _write(bench, machine, 'warehouse', topic_name, to_ros(topic_name, '/orders'))
    _write(bench, machine, 'back', topic_name, to_kafka('/orders', back, spool=SPOOL))
    _install(machine)
    machine.run('systemctl', 'enable', '--now', 'ros2-kafka-bridge@back')
    bench.produce(topic_name, [b'%d' % number for number in range(100)])
    bench.records(back, 100)
    _kill(machine, 'warehouse')
    machine.run('systemctl', 'reload', 'ros2-kafka-bridge@back')
    bench.produce(topic_name, [b'%d' % number for number in range(100, 200)])
    values = {record.value() for record in bench.records(back, 200)}
    assert values == {b'%d' % number for number in range(200)}
    for name in ('warehouse', 'back'):
        machine.run('systemctl', 'stop', f'ros2-kafka-bridge@{name}')
        assert _property(machine, name, 'Result') == 'success', _journal(machine)
    _is_clean(_journal(machine))


@pytest.mark.parametrize('home', ['read-only', 'yes'])
def test_the_unit_runs_as_a_robots_user_without_a_home_that_it_could_write_to(
    bench: Bench, topic_name: str, machine: Machine, home: str
) -> None:
    machine.run('useradd', '--create-home', 'robot')
    override = f'[Service]\nUser=robot\nGroup=robot\nProtectHome={home}\n'
    _adapt(machine, 'ros2-kafka-bridge@warehouse', override)
    _write(
        bench,
        machine,
        'warehouse',
        topic_name,
        to_kafka('/orders', f'{topic_name}.back', spool=SPOOL),
    )
    _install(machine)
    eventually(lambda: 'subscribes to /orders' in _journal(machine), 60)
    _is_clean(_journal(machine))
    assert machine.run('find', '/home/robot', '-name', '.ros') == ''


def _is_clean(journal: str) -> None:
    assert 'Traceback' not in journal, journal
    assert ' ERROR ' not in journal, journal


def _install(machine: Machine) -> None:
    """By the commands of the page, word for word."""
    if int(machine.run('systemctl', '--version').split()[1]) < _RELOADS_BY_NOTIFY:
        (line,) = re.findall(r'`(ExecReload=.*?)`', PAGE.read_text())
        _adapt(machine, 'ros2-kafka-bridge@', f'[Service]\n{line}\n')
    (block,) = re.findall(r'```\n(useradd.*?)```', PAGE.read_text(), re.DOTALL)
    for command in block.splitlines():
        machine.run('sh', '-c', f'cd {REPOSITORY} && {command}', timeout_s=120)


def _adapt(machine: Machine, unit: str, override: str) -> None:
    """As `systemctl edit` does."""
    folder = machine.path(f'/etc/systemd/system/{unit}.service.d')
    folder.mkdir(parents=True)
    # One of this name for a robot's bridge would count in the place of one for all bridges.
    (folder / f'{unit}.conf').write_text(override)


def _write(bench: Bench, machine: Machine, name: str, topic: str, route: dict[str, Any]) -> None:
    folder = machine.path(FILES)
    folder.mkdir(exist_ok=True)
    file = bench.config([route], name=f'{topic}-{name}', monitoring={'listen': 'off'})
    (folder / f'{name}.yaml').write_text(file.read_text())
    # Of another user than the tests' programs: not over shared memory.
    environ = f'ROS_DOMAIN_ID={bench.domain}\nFASTDDS_BUILTIN_TRANSPORTS=UDPv4\n'
    (folder / f'{name}.env').write_text(environ)


def _kill(machine: Machine, name: str) -> None:
    before = _property(machine, name, 'MainPID')
    machine.run('systemctl', 'kill', '--signal=KILL', f'ros2-kafka-bridge@{name}')

    def again() -> bool:
        now = _property(machine, name, 'MainPID')
        return now not in {before, '0'} and _property(machine, name, 'ActiveState') == 'active'

    eventually(again, 60, lambda: _journal(machine))


def _property(machine: Machine, name: str, wanted: str) -> str:
    return machine.run(
        'systemctl', 'show', f'--property={wanted}', '--value', f'ros2-kafka-bridge@{name}'
    )


def _journal(machine: Machine) -> str:
    return machine.run('journalctl', '--no-pager', '--output=cat', '--boot')
