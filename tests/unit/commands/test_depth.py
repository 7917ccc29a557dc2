"""The command `depth` with files: what it shows, draws and refuses."""

import json
from pathlib import Path

import numpy as np
import pytest
from support.processes.terminal import typed
from support.said import misfits

from ros2_kafka_bridge.depth.recorder import HEADER

MS = 1_000_000


def run(*arguments: str | Path) -> tuple[int, str, str]:
    return typed('depth', *arguments)


@pytest.fixture(scope='module')
def arrivals(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twenty thousand random arrivals, a thousand a second."""
    times = np.cumsum(np.random.default_rng(1).exponential(1e6, 20_000)).astype(np.int64)
    file = tmp_path_factory.mktemp('depth') / 'arrivals'
    file.write_text('\n'.join(map(str, times)))
    return file


def test_it_names_a_depth_and_the_loss_at_the_usual_ones(arrivals: Path) -> None:
    status, out, err = run('--arrivals', arrivals, '--service', '0.8ms', '--loss', '1e-4')
    assert (status, err) == (0, '')
    lines = [' '.join(line.split()) for line in out.splitlines()]
    assert '20,000 messages in 19.9 s, 1,002.5 a second; the reader is busy 80.2%' in lines[0]
    assert lines[0].endswith('; at most 20 waited at once')
    assert lines[1] == 'Loss by depth (wanted: 0.0001)'
    shown = [line.split()[0] for line in lines[3:] if line[0].isdigit()]
    assert {'10', '100', '200'} <= set(shown)
    recommended = lines[-1].removeprefix('Recommended: KEEP_LAST, depth ')
    assert 17 <= int(recommended) <= 60  # M/D/1 with four fifths busy needs 17
    assert any(line.startswith(recommended) and 'recommended:' in line for line in lines)


def test_programs_get_the_same_as_json(arrivals: Path) -> None:
    status, out, _ = run(
        '--arrivals', arrivals, '--service', '800us', '--loss', '1e-4', '--depth', '7', '--json'
    )
    found = json.loads(out)
    assert status == 0
    assert found['load']['messages'] == 20_000
    assert found['load']['utilisation'] == pytest.approx(0.8, rel=0.03)
    depths = [one['depth'] for one in found['predictions']]
    assert depths == sorted({7, found['recommended'], found['estimated']})
    first = found['predictions'][0]
    assert first['low'] <= first['loss'] <= first['high']


def test_how_long_an_idle_reader_takes_to_begin_is_asked_for_and_shown(arrivals: Path) -> None:
    given = ['--arrivals', str(arrivals), '--service', '0.5ms', '--loss', '0.01', '--json']
    status, out, _ = run(*given)
    assert status == 0
    at_once = json.loads(out)
    assert at_once['load']['wake_seconds'] == 0
    assert 'is taken to begin at once' in ' '.join(at_once['notes'])
    assert '--wake (as 0.2ms)' in ' '.join(at_once['notes'])
    status, out, _ = run(*given, '--wake', '10ms')
    assert status == 0
    slow = json.loads(out)
    assert slow['load']['wake_seconds'] == 0.01
    assert 'begin at once' not in ' '.join(slow['notes'])
    assert slow['recommended'] > at_once['recommended'] + 5
    _, shown, _ = run(*given[:-1], '--wake', '10ms')
    assert 'begins 10 ms after a message that meets it idle' in ' '.join(shown.split())


def test_a_recording_tells_how_long_an_idle_reader_takes_and_may_be_overruled(
    tmp_path: Path,
) -> None:
    # Bursts of five, 20 ms apart; it begins 3 ms after the first, and takes 1 ms for each.
    rows = [
        (at, max(at + 3 * MS, at - n * 1000 + (3 + n) * MS), at - n * 1000 + (4 + n) * MS)
        for burst in range(400)
        for n in range(5)
        for at in [burst * 20 * MS + n * 1000]
    ]
    file = tmp_path / 'times'
    file.write_text('\n'.join([HEADER, *(f'{a} {s} {e} 0' for a, s, e in rows), '']))
    given = ['--loss', '0.01', '--depth', '4', '--json']
    recorded = json.loads(run('--recording', file, *given)[1])
    assert recorded['load']['wake_seconds'] == 0.003
    assert recorded['predictions'][0]['loss'] == pytest.approx(0.2)
    parted = json.loads(run('--arrivals', file, '--service-file', file, *given)[1])
    assert parted['predictions'] == recorded['predictions']
    overruled = json.loads(run('--recording', file, '--wake', '0us', *given)[1])
    assert overruled['load']['wake_seconds'] == 0
    assert overruled['predictions'][0]['replayed'] == 0


@pytest.mark.parametrize(('suffix', 'begins'), [('png', b'\x89PNG'), ('svg', b'<?xml')])
def test_it_draws(arrivals: Path, tmp_path: Path, suffix: str, begins: bytes) -> None:
    picture = tmp_path / f'depth.{suffix}'
    status, out, err = run('--arrivals', arrivals, '--service', '0.8ms', '--plot', picture)
    assert (status, err) == (0, '')
    assert out.endswith(f'drawn: {picture}\n')
    assert picture.read_bytes().startswith(begins)


def test_a_reader_that_is_too_slow_is_told_and_exits_with_1(arrivals: Path) -> None:
    status, out, _ = run('--arrivals', arrivals, '--service', '2ms')
    assert status == 1
    assert 'no depth helps' in out
    assert out.endswith('No depth can be recommended.\n')


def test_everything_that_is_missing_is_said_at_once() -> None:
    status, out, err = run('--loss', '-1', '--depth', '0')
    assert (status, out) == (2, '')
    wanted = [
        'arrivals: one of --kafka, --ros, --arrivals, --recording is needed...',
        'service times: --service (as 0.8ms) or --service-file ... ServiceTimes (docs/depth.md)',
        '--loss: -1 ...',
        '--depth: ... 1 or more',
    ]
    assert misfits(err.splitlines(), wanted) == []


@pytest.mark.parametrize(
    ('arguments', 'said'),
    [
        (['--arrivals', 'a', '--ros', '/a', '--service', '1ms'], 'not --ros and --arrivals'),
        (['--recording', 'a', '--service', '1ms'], '--service and --recording each say them'),
        (['--arrivals', 'one', '--service', 'soon'], "'soon' is not a time with its unit"),
        (['--arrivals', 'one', '--service', '1.2.3ms'], "'1.2.3ms' is not a time"),
        (['--arrivals', 'two', '--service', '1ms', '--wake', '3'], "--wake: '3' is not a time"),
        (['--arrivals', 'one', '--service', '1ms'], '1 message of one moment, of which no depth'),
        (['--arrivals', 'same', '--service', '1ms'], '3 messages of one moment'),
        (['--arrivals', 'unsorted', '--service', '1ms'], 'sort the file'),
        (['--arrivals', 'gone', '--service', '1ms'], 'gone: No such file'),
        (['--kafka', 'a', '--service', '1ms', '-X', 'acks'], '-X acks: is not of the form'),
        (['--kafka', 'a', '--service', '1ms', '-X', 'group.id=a'], '-X group.id: '),
        (['--kafka', 'a', '--service', '1ms', '-X', 'no.such=1'], 'knows no such property'),
        (
            ['--arrivals', 'two', '--service', '1ms', '--plot', 'a.docx'],
            'ends in .png, .svg, .pdf',
        ),
        (
            ['--arrivals', 'two', '--service', '1ms', '--plot', 'no/a.png'],
            'there is no directory no',
        ),
    ],
)
def test_a_mistake_is_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'one').write_text('1\n')
    (tmp_path / 'same').write_text('1\n1\n1\n')
    (tmp_path / 'two').write_text('1000000\n9000000\n')
    (tmp_path / 'unsorted').write_text('2\n1\n')
    status, _, err = run(*arguments)
    assert status == 2
    assert said in err
    assert 'Traceback' not in err
