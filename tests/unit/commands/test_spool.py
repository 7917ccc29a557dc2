"""The command `spool`: what it shows, and that it touches nothing."""

import json
import os
import time
from pathlib import Path
from typing import Any

import pytest
from support.processes.terminal import on_terminal, typed, without_colours
from support.spools.files import GID, make, opened, row, rows

from ros2_kafka_bridge.commands.spool.report import SpoolOptions, report
from ros2_kafka_bridge.endpoints import Outgoing
from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.spool.store import file_of

NOTHING_MORE = SpoolOptions(messages=0, values=False, as_json=False)

CONFIGURATION = """
name: bridge
kafka: {{bootstrap.servers: localhost:9092}}
routes:
  - name: route
    from: {{ros: /orders}}
    to: {{kafka: orders}}
    format: text
    spool: {{path: {place}}}
  - name: unused
    from: {{ros: /others}}
    to: {{kafka: others}}
    format: text
    spool: {{path: {place}}}
  - name: without
    from: {{ros: /third}}
    to: {{kafka: third}}
    format: text
"""


def files(place: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in place.iterdir()}


def as_json(path: Path, capsys: pytest.CaptureFixture[str], **asked: Any) -> tuple[int, Any]:
    status = report(path, NOTHING_MORE._replace(as_json=True, **asked))
    return status, json.loads(capsys.readouterr().out)['spools']


def fill(place: Path) -> Path:
    """Thirty messages and a dead letter, taken two hours ago."""
    taken_ns = time.time_ns() - 7_200_000_000_000
    with opened(place) as spool:
        spool.append([one._replace(taken_ns=taken_ns) for one in rows(1, 30)])
        spool.append([row(31)._replace(dead=True, gid=b'', seq=0, taken_ns=taken_ns)])
    return file_of(place, 'bridge', 'route')


def killed(tmp_path: Path) -> Path:
    """The files of a hundred messages as a bridge leaves them that is killed."""
    source, place = tmp_path / 'source', tmp_path / 'killed'
    place.mkdir()
    with opened(source, 100):
        for file in source.iterdir():
            (place / file.name).write_bytes(file.read_bytes())
    return place


def test_it_shows_what_waits_and_where_it_goes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = fill(tmp_path)
    before = files(tmp_path)
    assert report(file, NOTHING_MORE) == 0
    title, head, line = capsys.readouterr().out.splitlines()
    assert title == f'Spools in {tmp_path}'
    assert head.split() == ['spool', 'messages', 'size', 'oldest', 'newest', 'way', 'state']
    cells = [cell for cell in line.split('  ') if cell]
    assert cells[0] == 'bridge.route.spool'
    assert cells[1].strip() == '31'
    assert cells[3].strip().endswith('; 2 h ago')
    assert cells[5].strip() == '/orders; -> orders'
    assert cells[6].strip().startswith('well; not open; 1 dead letter; version 1; file ')
    assert files(tmp_path) == before


def test_it_looks_on_while_a_bridge_uses_the_spool(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fill(tmp_path)
    with opened(tmp_path) as spool:
        for first in range(32, 1032, 100):
            spool.append(rows(first, first + 99))
            spool.delete_before(first - 50)
            status, (seen,) = as_json(tmp_path, capsys)
            assert (status, seen['damage']) == (0, '')
            assert (seen['messages'], seen['bytes']) == (spool.count, spool.size_bytes)
            assert seen['pid'] == os.getpid()


def test_it_touches_nothing_of_a_spool_whose_bridge_was_killed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = killed(tmp_path)
    for _ in range(2):  # with the index of the log, then without it
        before = files(place)
        status, (seen,) = as_json(place, capsys)
        assert (status, seen['messages'], seen['damage'], seen['pid']) == (0, 100, '', 0)
        assert files(place) == before
        (place / 'bridge.route.spool-shm').unlink(missing_ok=True)


@pytest.mark.parametrize('damaged', [False, True])
def test_without_a_directory_for_a_copy_it_says_which_is_missing(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    *,
    damaged: bool,
) -> None:
    file = fill(tmp_path)
    log = file.with_name(f'{file.name}-wal')
    if damaged:
        os.truncate(file, 5000)
    else:
        log.write_bytes(b'not one that is empty')
    monkeypatch.setattr('tempfile.tempdir', str(tmp_path / 'gone'))
    status, (shown,) = as_json(tmp_path, capsys)
    assert status == 2
    assert 'no directory for temporary files (No such file or directory)' in shown['problem']


def test_what_a_damaged_log_costs_is_said_and_it_is_left_as_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = killed(tmp_path)
    log = place / 'bridge.route.spool-wal'
    log.write_bytes(b'\0' + log.read_bytes()[1:])
    before = files(place)
    status, (seen,) = as_json(place, capsys)
    assert (status, seen['messages'], seen['lost']) == (1, 0, 100)
    assert seen['damage'] == 'its last transactions are missing'
    assert files(place) == before


def test_it_shows_the_first_messages(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    record = Outgoing('orders', None, b'a\x1b[31m\nb\xff' + b'x' * 100, [])
    with opened(tmp_path) as spool:
        spool.append([row(1)._replace(record=record), *rows(2, 5)])
    assert report(tmp_path, NOTHING_MORE._replace(messages=2)) == 0
    shown = capsys.readouterr().out
    assert 'bridge.route.spool: the first 2 of 5' in shown
    assert 'value' not in shown
    assert report(tmp_path, NOTHING_MORE._replace(messages=2, values=True)) == 0
    lines = capsys.readouterr().out.splitlines()
    assert 'null' in lines[-2]
    assert r'a\x1b[31m\nb\xffxxx' in lines[-2]
    assert lines[-2].endswith('x...')
    assert '/orders' in lines[-1]
    assert GID.hex() in lines[-1]
    status, (seen,) = as_json(tmp_path, capsys, messages=1, values=True)
    assert status == 0
    (one,) = seen['rows']
    assert (one['number'], one['key'], one['seq'], one['gid']) == (1, 'null', 1, GID.hex())
    assert one['value'].startswith(r'a\x1b[31m\nb\xff')


def test_a_damaged_one_is_said_and_left_as_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = fill(tmp_path)
    content = bytearray(file.read_bytes())
    content[content.index(b'20 20 ')] ^= 255
    file.write_bytes(content)
    before = files(tmp_path)
    assert report(file, NOTHING_MORE) == 1
    shown = capsys.readouterr().out
    assert 'DAMAGED' in shown
    said = f'{file} is damaged: row 20 is not as it was written, 1 message lost'
    assert said in shown
    status, (seen,) = as_json(file, capsys, messages=50)
    assert (status, seen['messages'], seen['lost']) == (1, 30, 1)
    assert [one['number'] for one in seen['rows']] == [n for n in range(1, 32) if n != 20]
    assert files(tmp_path) == before


@pytest.mark.parametrize('cut', [0, 1, 50, 5000, 9000])
def test_one_that_was_cut_off_is_damaged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], cut: int
) -> None:
    file = fill(tmp_path)
    os.truncate(file, cut)
    status, (seen,) = as_json(file, capsys)
    assert status == 1
    assert seen['damage']
    assert seen['messages'] + seen['lost'] == 31


def test_a_configuration_names_the_spools_of_its_routes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / 'bridge.yaml'
    place = tmp_path / 'spool'
    file.write_text(CONFIGURATION.format(place=place))
    assert report(file, NOTHING_MORE) == 0
    assert capsys.readouterr().out.count('  not there\n') == 2
    assert not place.exists()
    fill(place)
    status, seen = as_json(file, capsys)
    assert status == 0
    told = [(one['route'], one['exists'], one['messages']) for one in seen]
    assert told == [('route', True, 31), ('unused', False, 0)]


def test_of_a_spool_that_is_gone_its_lock_file_tells_what_is_lost(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config, place = tmp_path / 'bridge.yaml', tmp_path / 'spool'
    config.write_text(CONFIGURATION.format(place=place))
    file = fill(place)
    file.unlink()
    for asked in (config, place, file):
        assert report(asked, NOTHING_MORE) == 1
        assert f'{file} is missing: 31 messages are lost, by its lock file; mount' in (
            capsys.readouterr().out
        )
    status, (seen,) = as_json(place, capsys)
    told = ('exists', 'messages', 'lost', 'certain', 'damage')
    assert status == 1
    assert [seen[name] for name in told] == [False, 0, 31, True, 'the file is missing']


def test_one_that_is_deleted_while_a_bridge_has_it_open_is_not_lost_yet(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with opened(tmp_path) as spool:
        spool.append(rows(1, 30))
        file_of(tmp_path, 'bridge', 'route').unlink()
        assert report(tmp_path, NOTHING_MORE) == 1
    shown = capsys.readouterr().out
    assert f'MISSING; open (pid {os.getpid()})' in ' '.join(shown.split())
    assert 'a process has it open: 30 messages in it, by its lock file, are lost if' in shown


def test_without_the_lock_file_that_would_tell_of_a_missing_one_nothing_is_known(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = fill(tmp_path)
    lock = file.with_name(f'{file.name}.lock')
    lock.unlink()
    lock.symlink_to(lock)  # also root cannot read it
    status, (seen,) = as_json(tmp_path, capsys)
    assert (status, seen['messages'], seen['is_open'], seen['certain']) == (0, 31, None, False)
    assert report(tmp_path, NOTHING_MORE) == 0
    assert 'not known who has it' in capsys.readouterr().out
    file.unlink()
    status, (seen,) = as_json(tmp_path, capsys)
    assert (status, seen['messages'], seen['lost'], seen['exists']) == (2, None, None, False)
    assert 'its lock file, which tells what was in it, cannot be read' in seen['problem']


def test_of_one_that_cannot_be_read_no_number_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_: Path) -> bytes:
        raise PermissionError(13, 'Permission denied')

    file = fill(tmp_path)
    monkeypatch.setattr('ros2_kafka_bridge.spool.health.beginning_of', refuse)
    status, (seen,) = as_json(tmp_path, capsys)
    assert (status, seen['problem']) == (2, 'cannot be read: Permission denied')
    assert [seen[name] for name in ('messages', 'bytes', 'dead_letters', 'lost')] == [None] * 4
    assert (seen['exists'], seen['file_bytes']) == (True, file.stat().st_size)


@pytest.mark.parametrize('with_lock', [True, False])
def test_how_much_a_damaged_one_has_lost_is_said_only_where_its_lock_file_tells(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], *, with_lock: bool
) -> None:
    file = fill(tmp_path)
    os.truncate(file, 0)
    if not with_lock:
        file.with_name(f'{file.name}.lock').unlink()
    assert report(file, NOTHING_MORE) == 1
    lost = '31 messages lost' if with_lock else 'an unknown number of messages lost'
    assert f'the file is empty, {lost}. What' in capsys.readouterr().out
    _, (seen,) = as_json(file, capsys)
    assert seen['lost'] == (31 if with_lock else None)


def test_where_nothing_is_it_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert report(tmp_path, NOTHING_MORE) == 0
    assert capsys.readouterr().out == f'{tmp_path}: no spool in this directory\n'
    file = tmp_path / 'bridge.yaml'
    file.write_text(
        '\n'.join(
            line for line in CONFIGURATION.format(place='/x').splitlines() if 'spool' not in line
        )
    )
    assert report(file, NOTHING_MORE) == 0
    assert capsys.readouterr().out == f'{file}: no route has a spool\n'
    assert as_json(file, capsys) == (0, [])


def test_an_empty_spool_is_well(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    make(tmp_path).open()
    status, (seen,) = as_json(tmp_path, capsys)
    assert (status, seen['messages'], seen['oldest_ns'], seen['damage']) == (0, 0, None, '')


def test_a_file_that_is_none_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fill(tmp_path)
    other = tmp_path / 'other.spool'
    other.write_text('a diary')
    assert report(tmp_path, NOTHING_MORE) == 2
    out, err = capsys.readouterr()
    assert 'bridge.route.spool' in out
    assert err == f'{other}: is not a spool\n'
    with pytest.raises(ConfigError, match='there is no such file or directory'):
        report(tmp_path / 'nowhere', NOTHING_MORE)


def test_the_command_line_has_it(tmp_path: Path) -> None:
    fill(tmp_path)
    status, out, err = typed('spool', tmp_path, '--json')
    assert (status, err) == (0, '')
    assert json.loads(out)['spools'][0]['messages'] == 31
    nowhere = tmp_path / 'nowhere'
    said = f'{nowhere}: there is no such file or directory\n'
    assert typed('spool', nowhere) == (2, '', said)


def test_it_fits_on_a_terminal(tmp_path: Path) -> None:
    fill(tmp_path)
    status, shown = on_terminal('spool', str(tmp_path), '--messages', '3', columns=80)
    assert status == 0
    assert all(len(line) <= 80 for line in without_colours(shown))
