"""Make the report anew from what was measured before.

`python -m benchmarks.experiment.report build/experiment`
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import msgspec

from benchmarks.experiment.report import write_report
from benchmarks.experiment.results import EXPERIMENT_FILE, read


def main(arguments: Sequence[str] | None = None) -> int:
    """Read, write, say where; returns the exit status."""
    options = _parse(arguments)
    given: Path = options.measured
    file = given / EXPERIMENT_FILE if given.is_dir() else given
    try:
        experiment = read(file)
    except OSError as error:
        print(
            f'{file}: cannot be read: {error.strerror}. `python -m benchmarks.experiment --out '
            f'{file.parent}` measures and writes it',
            file=sys.stderr,
        )
        return 2
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        print(
            f'{file}: is no stored experiment: {error}. Give the {EXPERIMENT_FILE} that '
            '`python -m benchmarks.experiment` wrote, or its directory',
            file=sys.stderr,
        )
        return 2
    try:
        print(write_report(experiment, options.to or file.parent))
    except OSError as error:
        print(f'the report cannot be written: {error}', file=sys.stderr)
        return 1
    return 0


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.experiment.report',
        description='Makes the report anew from what was measured before.',
    )
    parser.add_argument(
        'measured', type=Path, metavar='FILE_OR_DIR', help=f'{EXPERIMENT_FILE}, or where it is'
    )
    parser.add_argument('--to', type=Path, metavar='DIR', help='default: beside the file')
    return parser.parse_args(arguments)


if __name__ == '__main__':
    sys.exit(main())
