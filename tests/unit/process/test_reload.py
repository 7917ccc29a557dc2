"""What differs between two configurations, what is said of it, and who is told what."""

import os
import selectors
import socket
import subprocess
import sys
import time
from collections.abc import Generator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from support.ros.package import write_package
from support.worlds.handles import handle, hear

from ros2_kafka_bridge.config.file import loads
from ros2_kafka_bridge.config.mistakes import field_names
from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.outside import extras
from ros2_kafka_bridge.outside.extras import install_command
from ros2_kafka_bridge.process import reload
from ros2_kafka_bridge.process.config_diff import (
    _OF_ALL_ROUTES,
    Checked,
    Difference,
    check,
    difference,
)
from ros2_kafka_bridge.process.load import load_checked
from ros2_kafka_bridge.process.monitor_process import bind
from ros2_kafka_bridge.process.plan import (
    Plan,
    Rank,
    Share,
    plan_of,
    read_plan,
    share_out,
    write_plan,
)
from ros2_kafka_bridge.process.reload import would
from ros2_kafka_bridge.process.systemd import Systemd
from ros2_kafka_bridge.protocol import worker as wire
from ros2_kafka_bridge.protocol.worker import (
    EVENTS,
    ORDERS,
    Begun,
    Drain,
    End,
    Loaded,
    PauseRoute,
    RoutesEnded,
)
from ros2_kafka_bridge.route.counters import Counters, to_line
from ros2_kafka_bridge.threads.stop import Part, Stop

HEAD = """\
name: test
kafka: {bootstrap.servers: x}
"""
ROUTES = """\
defaults: {format: text}
routes:
  - {name: a, from: {kafka: a}, to: {ros: /a, type: std_msgs/msg/String}, drain_s: 3}
  - {name: b, from: {ros: /b}, to: {kafka: b}}
"""
TEXT = HEAD + ROUTES
CHECK = (sys.executable, '-m', 'ros2_kafka_bridge.process.config_diff')


def plan(text: str, *chosen: str) -> Plan:
    return plan_of(loads(text, 'x', {}), Path('x'), frozenset(chosen) or None)


def found(before: str, after: str, *chosen: str) -> Difference:
    return difference(plan(before, *chosen), plan(after, *chosen))


def test_the_same_configuration_in_other_words_is_no_difference() -> None:
    spelled = TEXT.replace('drain_s: 3', 'drain_s: 3.0, max_in_flight: 500') + '# a comment\n'
    assert found(TEXT, spelled) == Difference(unchanged=('a', 'b'))
    assert would(found(TEXT, spelled)) == 'nothing has changed'


def test_the_order_of_the_routes_is_no_difference() -> None:
    *head, a, b = TEXT.splitlines()
    assert found(TEXT, '\n'.join([*head, b, a])).is_empty


def test_every_field_of_a_configuration_is_looked_at() -> None:
    """One that is left out is changed in the file, and said to be no change."""
    looked_at = {*_OF_ALL_ROUTES, 'workers', 'monitoring', 'routes', 'defaults'}
    assert looked_at == set(field_names(Config))


def test_another_membership_starts_every_route_again() -> None:
    after = found(TEXT, TEXT + 'membership: dynamic\n')
    assert after.changed == ('a', 'b')
    assert after.lines == ('membership: static -> dynamic',)


def test_routes_that_come_go_and_change_are_told_apart_from_those_that_stay() -> None:
    after = TEXT.replace('drain_s: 3', 'drain_s: 4').replace('name: b', 'name: c')
    assert found(TEXT, after) == Difference(
        added=('c',),
        removed=('b',),
        changed=('a',),
        lines=('routes.a.drain_s: 3.0 -> 4.0', 'routes.c: added', 'routes.b: removed'),
    )
    assert would(found(TEXT, after)) == 'restarts a; starts c; ends b'


def test_a_changed_default_changes_the_routes_that_use_it() -> None:
    after = TEXT.replace('{format: text}', '{format: text, drain_s: 5}')
    assert found(TEXT, after).changed == ('b',)
    assert found(TEXT, after).lines == ('routes.b.drain_s: 8.0 -> 5.0',)


@pytest.mark.parametrize(
    ('more', 'line'),
    [
        ('ros: {domain_id: 7}\n', 'ros.domain_id: nothing -> 7'),
        ('tracing: {sample: 0.5}\n', 'tracing: nothing -> {"sample":0.5}'),
        ('schema_registry: {url: "http://h", basic.auth.user.info: "u:hidden"}\n', ''),
    ],
)
def test_what_all_routes_share_changes_all_of_them(more: str, line: str) -> None:
    it = found(TEXT, more + TEXT)
    assert it.changed == ('a', 'b')
    assert line in '\n'.join(it.lines)
    assert 'hidden' not in '\n'.join(it.lines)


def test_secrets_are_masked_whatever_becomes_of_them() -> None:
    one, two = (
        TEXT.replace('{bootstrap.servers: x}', f'{{bootstrap.servers: x, sasl.password: {word}}}')
        for word in ('secret1', 'secret2')
    )
    assert found(one, two).lines == ('kafka.sasl.password: has changed',)
    assert 'secret' not in str(found(TEXT, two).lines)
    first, second = (
        f'monitoring: {{token: "0123456789abcdef-secret{number}"}}\n{TEXT}' for number in (1, 2)
    )
    assert found(first, second).lines == ('monitoring.token: has changed',)
    assert found(first, second).unchanged == ('a', 'b')
    assert 'secret' not in str(found(TEXT, first))
    nobody = f'monitoring: {{}}\n{TEXT}'
    assert 'secret' not in str(found(nobody, first))


@pytest.mark.parametrize(
    ('more', 'line'),
    [
        ('workers: 2\n', 'workers: 1 -> 2'),
        ('monitoring: {listen: "[::1]:1"}\n', 'monitoring.listen: 127.0.0.1:9464 -> [::1]:1'),
        ('monitoring: {node: false}\n', 'monitoring.node: true -> false'),
        ('monitoring: {start: unconfigured}\n', 'monitoring.start: active -> unconfigured'),
    ],
)
def test_what_counts_from_the_next_start_on_changes_no_route(more: str, line: str) -> None:
    before = TEXT if 'monitoring' not in more else f'monitoring: {{}}\n{TEXT}'
    it = found(before, more + TEXT)
    assert it.at_next_start == (line,)
    assert it.unchanged == ('a', 'b')
    assert it.all_lines == (f'{line} (from the next start on)',)
    assert 'only when the bridge is started again' in would(it)


def test_watching_a_bridge_that_nobody_watched_begins_with_its_next_start() -> None:
    it = found(TEXT, f'monitoring: {{}}\n{TEXT}')
    assert it.lines == ()
    assert len(it.at_next_start) == 1


def test_only_the_chosen_routes_count() -> None:
    after = TEXT.replace('drain_s: 3', 'drain_s: 4')
    assert found(TEXT, after, 'b').is_empty
    assert found(TEXT, after, 'a').changed == ('a',)


# The check, in a process of its own


def ended_check(before: Plan) -> Checked:
    """What comes of a check at its end."""
    with selectors.DefaultSelector() as selector:
        return ended(reload.check(before, selector))


def ended(steps: Generator[None, None, Checked]) -> Checked:
    while True:
        try:
            next(steps)
        except StopIteration as end:
            found: Checked = end.value
            return found
        time.sleep(0.05)


def checked(before: Plan) -> Any:
    descriptor = write_plan(before)
    try:
        done = subprocess.run(
            [*CHECK, f'--plan={descriptor}', '--result=1'],
            pass_fds=[descriptor],
            capture_output=True,
            check=True,
            timeout=60,
        )
    finally:
        os.close(descriptor)
    return msgspec.json.decode(done.stdout)


def test_a_changed_secret_file_is_a_change_though_the_text_is_the_same(tmp_path: Path) -> None:
    file, secret = tmp_path / 'bridge.yaml', tmp_path / 'password'
    file.write_text(TEXT.replace('{bootstrap.servers: x}', '{bootstrap.servers: x, '
                    'sasl.password: "${file:password}"}'))  # fmt: skip
    secret.write_text('first')
    before = plan_of(load_checked(file), file)
    assert check(before).difference.is_empty
    secret.write_text('second')
    it = check(before)
    assert it.difference.changed == ('a', 'b')
    assert it.difference.lines == ('kafka.sasl.password: has changed',)


def test_the_folder_of_types_of_a_file_that_was_named_without_its_own_is_the_same_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else the first reload would start every route again."""
    monkeypatch.chdir(tmp_path)
    file = Path('bridge.yaml')
    file.write_text(f'{TEXT}ros: {{message_path: [messages]}}\n')
    write_package(Path('messages'), 'acme_msgs', {'Crane': 'float64 height'})
    before = plan_of(load_checked(file), file.absolute())
    assert check(before).difference.is_empty


def test_every_mistake_is_told_and_a_chosen_route_that_is_gone_is_one(tmp_path: Path) -> None:
    file = tmp_path / 'bridge.yaml'
    file.write_text(TEXT)
    before = plan_of(load_checked(file), file, frozenset(['b']))
    file.write_text(TEXT.replace('/b', 'b').replace('/a', 'a'))
    problems = checked(before)['problems']
    assert len(problems) == 2
    assert all(problem.startswith(f'{file}:') for problem in problems)
    file.write_text(TEXT.replace('name: b', 'name: c'))
    assert checked(before)['problems'] == ['--routes: no route b, there are a, c']


def test_a_file_that_cannot_be_read_to_its_end_is_told_with_the_time_that_it_has_had(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A FIFO that nobody writes, or a disk in a network that hangs."""
    monkeypatch.setattr(reload, '_CHECK_S', 2.0)
    file = tmp_path / 'bridge.yaml'
    os.mkfifo(file)
    problems = ended_check(plan_of(loads(TEXT, 'x', {}), file)).problems
    assert len(problems) == 1
    assert problems[0].startswith(f'{file}: reading it has taken longer than 2 s: ')


def test_a_check_that_breaks_down_is_told_as_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, 'executable', '/bin/false')
    problems = ended_check(plan_of(loads(TEXT, 'x', {}), tmp_path)).problems
    assert problems == ('the file could not be checked: the log says why',)


def test_a_plan_goes_through_a_file_in_memory_whoever_has_read_it_before() -> None:
    it = plan(TEXT)
    descriptor = write_plan(it)
    assert read_plan(descriptor) == read_plan(descriptor) == it
    os.close(descriptor)


# Orders and events


@pytest.mark.parametrize('order', [Drain(), End(('a', 'ü')), PauseRoute('a "b"'), wire.Begin()])
def test_an_order_is_one_line_and_comes_back_as_it_was(order: wire.WorkerOrder) -> None:
    line = wire.to_line(order)
    assert line.count(b'\n') == 1
    assert ORDERS.decode(line) == order


@pytest.mark.parametrize('event', [Loaded(), Begun(), RoutesEnded(('a',)), wire.RouteFailed()])
def test_an_event_is_one_line_and_comes_back_as_it_was(event: wire.Event) -> None:
    assert EVENTS.decode(wire.to_line(event)) == event


def test_a_worker_says_in_between_what_has_happened() -> None:
    worker = handle('a', 'b')
    snapshots = to_line([Counters('a', taken=3).snapshot(3), Counters('b').snapshot(0)])
    hear(worker, wire.to_line(Loaded()) + snapshots + wire.to_line(Begun()))
    assert worker.has_loaded
    assert worker.has_begun
    assert worker.snapshots['a'].taken == 3
    worker.leaving = {'a'}
    ended = wire.to_line(RoutesEnded(('a',)))
    hear(worker, snapshots + ended + b'{"type":"unheard of"}\n')
    assert list(worker.snapshots) == ['b']
    assert worker.leaving == set()


def test_the_one_worker_of_a_bridge_has_both_ways_and_further_ones_have_not() -> None:
    (both,) = share_out(['a'], ['b'], 1)
    assert both == Share(('a', 'b'), Rank.BOTH)
    assert both.rank is Rank.BOTH
    assert share_out(['a'], [], 1) == [Share(('a',), Rank.TO_ROS)]
    assert [share.rank for share in share_out(['a'], ['b'], 2)] == [Rank.TO_ROS, Rank.FROM_ROS]
    assert share_out([], [], 3) == []


def test_a_route_stops_alone_or_with_all() -> None:
    whole = Stop()
    one, other = Part(whole), Part(whole)
    one.ask()
    assert one.asked
    assert one.wait(60)
    assert not other.asked
    assert not whole.asked
    whole.ask()
    assert other.asked
    assert not one.at_once
    whole.ask()
    assert one.at_once
    assert other.at_once


# What watches the bridge


def test_an_address_is_taken_once() -> None:
    end = bind('127.0.0.1:0', 'x.yaml')
    assert end is not None
    with end:
        port = end.getsockname()[1]
        with pytest.raises(ConfigError, match=rf'x\.yaml: monitoring\.listen: .* port {port} is'):
            bind(f'127.0.0.1:{port}', 'x.yaml')
    assert bind('off', 'x.yaml') is None


@pytest.mark.skipif(not Path('/proc/net/if_inet6').exists(), reason='needs IPv6')
def test_an_address_of_ipv6_stands_in_brackets() -> None:
    end = bind('[::1]:0', 'x.yaml')
    assert end is not None
    with end:
        assert end.family == socket.AF_INET6


def test_a_bridge_that_is_watched_needs_its_extra_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(extras, 'find_spec', lambda name: None if name == 'uvicorn' else object())
    file = tmp_path / 'bridge.yaml'
    file.write_text(f'monitoring: {{}}\n{TEXT}')
    with pytest.raises(ConfigError) as caught:
        load_checked(file)
    sentence = str(caught.value)
    assert 'bridge.yaml:1: monitoring: unless it says listen: off, monitoring needs uv' in sentence
    assert sentence.endswith(install_command('monitoring'))  # to be copied to the end of the line
    file.write_text(f'monitoring: {{listen: off}}\n{TEXT}')
    load_checked(file)


def test_what_is_told_to_systemd_is_told_by_one_process_only() -> None:
    environ = {'NOTIFY_SOCKET': '@none', 'WATCHDOG_USEC': '5', 'WATCHDOG_PID': '1', 'HOME': '/'}
    it = Systemd.from_environ(environ)
    assert environ == {'HOME': '/'}
    it.ready('nobody listens, and nothing happens')
    it.alive()
