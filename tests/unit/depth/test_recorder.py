"""The recorder of service times, and the files that `depth` reads."""

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ros2_kafka_bridge.depth import ServiceTimes
from ros2_kafka_bridge.depth.recorder import HEADER
from ros2_kafka_bridge.depth.recording import read_arrivals, read_recording, read_service
from ros2_kafka_bridge.errors import ConfigError

MS = 1_000_000


def info(source_ns: int, seq: int | None = None, gid: bytes = b'a' * 16) -> dict[str, Any]:
    """What rclpy tells of a message."""
    return {
        'source_timestamp': source_ns,
        'received_timestamp': source_ns,
        'publication_sequence_number': seq,
        'publisher_gid': {'data': gid},
    }


def recording(place: Path, *rows: tuple[int, int, int, int]) -> Path:
    """A file of the recorder; arrival, start, end in milliseconds, and how many were missed."""
    lines = [f'{a * MS} {s * MS} {e * MS} {missed}' for a, s, e, missed in rows]
    file = place / 'times'
    file.write_text('\n'.join([HEADER, *lines, '']))
    return file


def test_each_message_is_written_with_arrival_start_and_end(tmp_path: Path) -> None:
    heard: list[str] = []
    before = time.time_ns()
    with ServiceTimes(tmp_path / 'times') as times:
        timed = times.timed(heard.append)
        timed('a', info(111))
        timed('b', info(222))
    header, *rows = (tmp_path / 'times').read_text().splitlines()
    assert header == HEADER
    assert heard == ['a', 'b']
    numbers = [[int(word) for word in row.split()] for row in rows]
    assert [row[0] for row in numbers] == [111, 222]
    starts_and_ends = [number for row in numbers for number in row[1:3]]
    assert starts_and_ends == sorted(starts_and_ends)
    assert before <= starts_and_ends[0]


def test_a_callback_that_takes_the_info_gets_it(tmp_path: Path) -> None:
    heard: list[tuple[Any, Any]] = []
    with ServiceTimes(tmp_path / 'times') as times:
        times.timed(lambda message, told: heard.append((message, told)))('a', info(1))
    assert heard == [('a', info(1))]


def test_rclpy_calls_the_wrapped_callback_with_the_info(tmp_path: Path) -> None:
    import inspect  # noqa: PLC0415 (the question of rclpy itself)

    with ServiceTimes(tmp_path / 'times') as times:
        signature = inspect.signature(times.timed(lambda _: None))
    with pytest.raises(TypeError):
        signature.bind(object())
    signature.bind(object(), object())


def test_a_callback_that_raises_is_recorded_and_still_raises(tmp_path: Path) -> None:
    def broken(_: str) -> None:
        raise RuntimeError('broken')

    with ServiceTimes(tmp_path / 'times') as times, pytest.raises(RuntimeError, match='broken'):
        times.timed(broken)('a', info(1))
    assert len((tmp_path / 'times').read_text().splitlines()) == 2


def test_messages_that_never_came_are_counted_for_each_publisher(tmp_path: Path) -> None:
    with ServiceTimes(tmp_path / 'times') as times:
        timed = times.timed(lambda _: None)
        for seq, gid in [(7, b'a'), (8, b'a'), (3, b'b'), (12, b'a'), (4, b'b'), (None, b'c')]:
            timed('', info(1, seq, gid * 16))
    rows = (tmp_path / 'times').read_text().splitlines()[1:]
    assert [row.split()[3] for row in rows] == ['0', '0', '0', '3', '0', '0']


def test_what_comes_after_the_end_is_still_called(tmp_path: Path) -> None:
    heard: list[str] = []
    times = ServiceTimes(tmp_path / 'times')
    timed = times.timed(heard.append)
    times.close()
    timed('late', info(1))
    assert heard == ['late']


def test_the_recorder_needs_nothing_but_python() -> None:
    program = (
        'import sys; from ros2_kafka_bridge.depth import ServiceTimes;'
        'assert not {"numpy", "scipy", "matplotlib", "rclpy", "rich", "pydantic"} & {*sys.modules}'
    )
    subprocess.run([sys.executable, '-c', program], check=True, timeout=30)


def test_a_message_that_waited_makes_the_service_before_it_last_until_its_start(
    tmp_path: Path,
) -> None:
    # The second came at 5, while the first was served until 10, and began at 12: the executor
    # took 2. The third came at 50, to an idle reader: the first two ms are what is usual.
    file = recording(tmp_path, (0, 0, 10, 0), (5, 12, 20, 0), (50, 51, 55, 0))
    found = read_recording(file)
    assert (found.service_ns // MS).tolist() == [12, 10, 6]
    assert (found.arrivals_ns // MS).tolist() == [0, 5, 50]
    assert found.notes == ()


def test_a_reader_that_was_never_busy_shows_no_overhead_and_says_so(tmp_path: Path) -> None:
    found = read_recording(recording(tmp_path, (0, 1, 3, 0), (10, 11, 14, 0)))
    assert (found.service_ns // MS).tolist() == [2, 3]
    assert 'no message ever waited' in found.notes[0]


def test_messages_that_met_an_idle_reader_tell_how_long_it_takes_to_begin(tmp_path: Path) -> None:
    # The second waited for the first; the first, the third and the fourth woke the reader.
    file = recording(tmp_path, (0, 3, 10, 0), (5, 12, 20, 0), (50, 51, 55, 0), (60, 62, 63, 0))
    found = read_recording(file)
    assert (found.wake_ns // MS).tolist() == [3, 1, 2]
    assert np.array_equal(read_service(file).wake_ns, found.wake_ns)


@pytest.mark.parametrize(('ahead', 'said'), [(-7, '-6.0 ms'), (3_600_000, '3,600,001.0 ms')])
def test_a_reader_whose_clock_differs_does_not_tell_it_and_says_so(
    tmp_path: Path, ahead: int, said: str
) -> None:
    # Seconds apart, so that each message meets an idle reader by a clock that is behind.
    gap = 1000 if ahead < 0 else 10_000_000
    rows = [(n * gap, n * gap + 1 + ahead, n * gap + 2 + ahead, 0) for n in range(20)]
    found = read_recording(recording(tmp_path, *rows))
    assert found.wake_ns.tolist() == [0]
    [note] = [note for note in found.notes if 'clocks' in note]
    assert f'began {said} after' in note
    assert 'say --wake' in note


def test_one_delay_that_cannot_be_is_cut_and_the_others_are_believed(tmp_path: Path) -> None:
    # The first was latched an hour ago; the clock went back by a little once.
    rows = [(n * 1000, n * 1000 + 2, n * 1000 + 3, 0) for n in range(3600, 3650)]
    file = recording(
        tmp_path, (0, 3_599_000, 3_599_001, 0), (*rows[0][:1], 3_599_999, 3_600_001, 0), *rows[1:]
    )
    found = read_recording(file)
    assert (found.wake_ns // MS).tolist() == [100, 0, *[2] * 49]
    assert not any('clock' in note for note in found.notes)


def test_messages_pushed_out_waited_or_woke_the_reader(tmp_path: Path) -> None:
    # Evenly filled in, the first that the second pushed out came at 2, and waited for the end at
    # 10, although the one that was taken came at 12. Before the last one at 48 came those of 40
    # and 44: the first of them woke the reader.
    file = recording(tmp_path, (0, 0, 10, 0), (12, 14, 16, 5), (36, 37, 38, 0), (48, 49, 50, 2))
    found = read_recording(file)
    assert (found.service_ns // MS).tolist() == [14, 6, 5, 5]
    assert (found.wake_ns // MS).tolist() == [0, 1, 9]


def test_messages_that_never_came_are_filled_in_evenly(tmp_path: Path) -> None:
    found = read_recording(recording(tmp_path, (0, 0, 1, 0), (40, 40, 41, 3), (50, 50, 51, 0)))
    assert (found.arrivals_ns // MS).tolist() == [0, 10, 20, 30, 40, 50]
    assert '3 messages never came to the callback' in found.notes[-1]


def test_arrivals_of_several_publishers_are_put_in_order(tmp_path: Path) -> None:
    found = read_recording(recording(tmp_path, (5, 6, 7, 0), (3, 7, 8, 0)))
    assert (found.arrivals_ns // MS).tolist() == [3, 5]


def test_a_line_that_a_kill_has_cut_is_left_out(tmp_path: Path) -> None:
    file = recording(tmp_path, (0, 0, 1, 0), (5, 5, 6, 0))
    file.write_text(file.read_text() + '700000 80')
    assert len(read_recording(file).service_ns) == 2


def test_callbacks_at_the_same_time_are_refused(tmp_path: Path) -> None:
    rows = [(n, n, n + 10, 0) for n in range(20)]
    with pytest.raises(ConfigError, match='19 callbacks began before'):
        read_recording(recording(tmp_path, *rows))


def test_a_recording_serves_for_arrivals_and_for_service_times(tmp_path: Path) -> None:
    file = recording(tmp_path, (0, 1, 3, 0), (10, 11, 14, 0))
    assert (read_arrivals(file) // MS).tolist() == [0, 10]
    assert (np.asarray(read_service(file).service_ns) // MS).tolist() == [2, 3]


def test_plain_files_may_have_comments_and_blank_lines(tmp_path: Path) -> None:
    file = tmp_path / 'plain'
    file.write_text('# made by hand\n1\n\n2  # here\n2\n')
    assert np.array_equal(read_arrivals(file), [1, 2, 2])
    assert np.array_equal(read_service(file).service_ns, [1, 2, 2])
    assert read_service(file).wake_ns == 0


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('3\n1\n2\n', 'time 2 of 3 is earlier than the one before it: sort the file'),
        ('1\ntwo\n', "plain:2: 'two' is not a time in nanoseconds"),
        ('', 'is empty'),
        ('# nothing\n', 'is empty'),
        (f'{HEADER}\n', 'holds no messages'),
        (f'{HEADER}\n1 2 3\n', 'four numbers'),
        (f'{HEADER}\n1 2 3 x\n', 'four numbers'),
    ],
)
def test_what_is_no_file_of_arrivals_is_refused(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / 'plain'
    file.write_text(text)
    with pytest.raises(ConfigError, match=said):
        read_arrivals(file)


def test_service_times_are_not_negative(tmp_path: Path) -> None:
    file = tmp_path / 'plain'
    file.write_text('1\n-2\n')
    with pytest.raises(ConfigError, match='negative'):
        read_service(file)


def test_a_file_that_is_not_there_or_no_text_is_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match='No such file'):
        read_arrivals(tmp_path / 'missing')
    (tmp_path / 'binary').write_bytes(b'\xff\xfe\x00')
    with pytest.raises(ConfigError, match='is not text'):
        read_arrivals(tmp_path / 'binary')


def test_a_plain_file_is_no_recording(tmp_path: Path) -> None:
    (tmp_path / 'plain').write_text('1\n2\n')
    with pytest.raises(ConfigError, match='use --arrivals'):
        read_recording(tmp_path / 'plain')
