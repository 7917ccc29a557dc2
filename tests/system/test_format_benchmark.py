"""The benchmark of the formats, and the fuzzer of their decoders."""

from pathlib import Path

import pytest

from benchmarks.formats.__main__ import Result, check, contestants, ratio
from benchmarks.formats.samples import samples
from benchmarks.fuzz_decoders import FORMAT_NAMES, TYPES, Finding, finding_of, run, seeds
from benchmarks.fuzz_versions import VERSIONS


def test_each_contestant_brings_each_message_back() -> None:
    for sample in samples()[:4]:
        names = [contestant.name for contestant in contestants(sample)]
        assert names == ['cdr', 'json', 'avro', 'protobuf', 'usual', 'rosbridge']
        for contestant in contestants(sample):
            assert check(contestant, sample)


def test_the_slower_direction_counts() -> None:
    usual = Result('Odometry', 700, 'usual', 900, 100.0, 90.0)
    mine = Result('Odometry', 700, 'json', 900, 10.0, 30.0)
    assert ratio([usual, mine], 'Odometry') == 3.0


@pytest.mark.parametrize('name', FORMAT_NAMES)
def test_every_input_to_begin_with_is_a_message(name: str) -> None:
    # One that writes such records is a stranger's: there is one direction.
    directions = 1 if name in VERSIONS else 2
    assert len({data[:2] for data in seeds(name)}) == directions * len(TYPES)


def test_a_finding_has_its_traceback_and_its_input(tmp_path: Path) -> None:
    (tmp_path / 'json-crash-0').write_bytes(b'\x00\x01{')
    said = '#2 INITED cov: 3 ft: 4\n\n === Uncaught Python exception: ===\nKeyError: 7\n#3 x\n'
    assert finding_of('json', 77, said, tmp_path) == Finding('KeyError: 7', '00017b')
    assert finding_of('json', 0, said, tmp_path) is None


def test_a_decoder_is_fuzzed_for_as_long_as_is_said(tmp_path: Path) -> None:
    pytest.importorskip('atheris')
    result = run('json', 1, 1, tmp_path)
    assert result.finding is None
    assert result.runs > 100
    assert result.branches > 100
