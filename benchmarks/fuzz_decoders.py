"""Bytes that a fuzzer finds, into the decoders of every format: only their own errors come out.

    python -m benchmarks.fuzz_decoders --seconds 60

Each format is a process with an equal share of the time, and so are records whose schema is a
stranger's (`fuzz_versions`). They are led by atheris (libFuzzer): it keeps what reaches new lines
of the formats, of the functions that they generate, and of the Python parts of confluent-kafka.
The first two bytes of an input choose the message type and the direction; the rest is a record, or
a message from ROS. What is decoded has to encode and come back as the same bytes. Native code
(msgspec, fastavro, protobuf) is run, but does not lead.
"""

import argparse
import json
import re
import subprocess
import sys
import tempfile
from base64 import b64encode
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from rich.console import Console
from rich.table import Table

from benchmarks.command import write
from benchmarks.fuzz_versions import VERSIONS, make_check, versions_of
from benchmarks.machine import machine, versions

if TYPE_CHECKING:
    from ros2_kafka_bridge.message_types.layout import Layout

FORMAT_NAMES: Final = ('cdr', 'json', 'avro', 'protobuf', *VERSIONS)
TYPES: Final = (
    'nav_msgs/msg/Odometry',
    'sensor_msgs/msg/JointState',
    'sensor_msgs/msg/CompressedImage',
    'diagnostic_msgs/msg/DiagnosticArray',
    'test_msgs/msg/BasicTypes',
    'test_msgs/msg/BoundedSequences',
    'test_msgs/msg/WStrings',
)
MAX_BYTES: Final = 4096
UNIT_S: Final = 10
MEMORY_MIB: Final = 2048
GRACE_S: Final = 60.0
_RUNS: Final = re.compile(r'^#(\d+)\s.*?cov: (\d+) ft: (\d+)', re.MULTILINE)
_DONE: Final = re.compile(r'^Done (\d+) runs', re.MULTILINE)
_WORDS: Final = (
    '{', '}', '[', ']', ',', ':', '"', 'null', 'true', 'false', '"NaN"', '"Infinity"',
    '-0.0', '1e308', '18446744073709551615', '9223372036854775808', '\\ud83d', '\\u0000',
)  # fmt: skip


class Finding(NamedTuple):
    """What must not come out.

    Args:
        what: The last lines that were said.
        data: The input, as hex.
    """

    what: str
    data: str


class Result(NamedTuple):
    """What became of one format.

    Args:
        branches: Places of the instrumented code that were reached.
        corpus: How many inputs reached something new.
    """

    format: str
    runs: int
    branches: int
    corpus: int
    finding: Finding | None


# In the process of one format, where the bridge is imported with the fuzzer's instruments


def fuzz(format_name: str, options: list[str]) -> None:
    """Lead a fuzzer through one format; it ends the process itself."""
    # It has no types, and changes how modules are loaded.
    import atheris  # type: ignore[import-untyped]  # noqa: PLC0415

    with atheris.instrument_imports(
        include=['ros2_kafka_bridge.formats', 'confluent_kafka.schema_registry']
    ):
        _instrument_generated(atheris.instrument_func)
        checks = [_check_of(format_name, name) for name in TYPES]

    def one_input(data: bytes) -> None:
        if len(data) > 2:
            to_ros, to_kafka = checks[data[0] % len(checks)]
            (to_ros if data[1] & 1 else to_kafka)(data[2:])

    atheris.Setup([sys.argv[0], *options], one_input)
    atheris.Fuzz()


Check = Callable[[bytes], None]


def _check_of(format_name: str, type_name: str) -> tuple[Check, Check]:
    """The two directions of one message type."""
    from ros2_kafka_bridge.errors import DecodeError, EncodeError  # noqa: PLC0415
    from ros2_kafka_bridge.message_types import load_layout  # noqa: PLC0415

    if format_name in VERSIONS:
        check = make_check(format_name, load_layout(type_name))
        return check, check
    decode, encode = _functions(format_name, load_layout(type_name))

    def to_ros(value: bytes) -> None:
        try:
            message = decode(value)
        except DecodeError:
            return
        again = decode(encode(message))
        if again != message:
            raise AssertionError(f'{type_name}: {message.hex()} came back as {again.hex()}')

    def to_kafka(value: bytes) -> None:
        try:
            record = encode(value)
        except EncodeError:
            return
        message = decode(record)
        if decode(encode(message)) != message:
            raise AssertionError(f'{type_name}: {message.hex()} does not come back')

    return to_ros, to_kafka


def _functions(
    format_name: str, layout: 'Layout'
) -> tuple[Callable[[Any], bytes], Callable[[Any], Any]]:
    from ros2_kafka_bridge.config.formats import JsonSettings, SchemaSettings  # noqa: PLC0415
    from ros2_kafka_bridge.formats import FORMATS  # noqa: PLC0415
    from ros2_kafka_bridge.formats.scope import Scope  # noqa: PLC0415

    scope = Scope('fuzz', JsonSettings(missing='default'), SchemaSettings(registry=False))
    made = FORMATS[format_name]
    return made.make_decode(layout, scope), made.make_encode(layout, scope)


def _instrument_generated(instrument: Callable[[Any], Any]) -> None:
    """Instrument what the formats compile at run time, too."""
    from ros2_kafka_bridge.formats.generated import Source  # noqa: PLC0415

    plain: Any = Source.function
    setattr(Source, 'function', lambda *given: instrument(plain(*given)))  # noqa: B010 -- patched


def seeds(format_name: str) -> Iterator[bytes]:
    """Inputs to begin with: for each type and direction an empty message and a filled one."""
    from ros2_kafka_bridge.message_types import load_layout  # noqa: PLC0415

    for number, type_name in enumerate(TYPES):
        layout = load_layout(type_name)
        from_json, _ = _functions('json', layout)
        _, encode = _functions(VERSIONS.get(format_name, format_name), layout)
        for fields in (b'{}', json.dumps(_filled(layout)).encode()):
            message = from_json(fields)
            value = encode(message) or b''
            if format_name in VERSIONS:
                yield from (bytes([number, 1]) + one for one in versions_of(format_name, value))
                continue
            yield bytes([number, 0]) + message
            yield bytes([number, 1]) + value


def _filled(kind: Any) -> Any:
    from ros2_kafka_bridge.message_types import layout as kinds  # noqa: PLC0415

    match kind:
        case kinds.Layout():
            return {field.name: _filled(field.kind) for field in kind.fields}
        case kinds.Array() | kinds.Sequence():
            times = kind.length if isinstance(kind, kinds.Array) else 2
            if kind.item in (kinds.Primitive('uint8'), kinds.Primitive('byte')):
                return b64encode(bytes(times)).decode()
            return [_filled(kind.item)] * times
        case kinds.String():
            return 'aß'
        case kinds.Primitive('bool'):
            return True
        case _:
            return 1


# In the process that starts them


def run(format_name: str, seconds: int, seed: int, place: Path) -> Result:
    """Fuzz one format in a process of its own."""
    corpus = place / format_name
    corpus.mkdir()
    for number, data in enumerate(seeds(format_name)):
        (corpus / f'seed{number}').write_bytes(data)
    dictionary = place / 'words'
    words = [word.replace('\\', '\\\\').replace('"', '\\"') for word in _WORDS]
    dictionary.write_text(''.join(f'"{word}"\n' for word in words), encoding='utf-8')
    options = {
        'max_total_time': seconds,
        'seed': seed,
        'max_len': MAX_BYTES,
        'timeout': UNIT_S,
        'rss_limit_mb': MEMORY_MIB,
        'artifact_prefix': f'{place}/{format_name}-',
        'dict': dictionary,
    }
    command = [
        *(sys.executable, '-m', 'benchmarks.fuzz_decoders', '--format', format_name),
        *(f'-{name}={value}' for name, value in options.items()),
        str(corpus),
    ]
    done = subprocess.run(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        timeout=seconds + GRACE_S,
        check=False,
    )
    return _result(format_name, done.returncode, done.stdout.decode(errors='replace'), place)


def _result(format_name: str, status: int, said: str, place: Path) -> Result:
    lines = _RUNS.findall(said)
    finished = _DONE.search(said)
    runs = int(finished[1]) if finished else int(lines[-1][0]) if lines else 0
    branches = int(lines[-1][1]) if lines else 0
    corpus = len(list((place / format_name).iterdir()))
    return Result(
        format_name, runs, branches, corpus, finding_of(format_name, status, said, place)
    )


def finding_of(format_name: str, status: int, said: str, place: Path) -> Finding | None:
    """What a process that ended with this status has found.

    Args:
        format_name: Its format.
        status: 0 without a finding.
        said: What it wrote.
        place: Where it put its input.
    """
    if not status:
        return None
    inputs = sorted(place.glob(f'{format_name}-*'))
    _, found, rest = said.partition('=== Uncaught Python exception: ===')
    lines = (rest if found else said).splitlines()
    told = [line for line in lines if line.strip() and not line.startswith(('#', 'INFO', '=='))]
    return Finding('\n'.join(told[-30:]), inputs[0].read_bytes().hex() if inputs else '')


def show(results: Sequence[Result], console: Console) -> None:
    """Print the table, and each finding."""
    table = Table('format', 'inputs', 'branches', 'corpus', 'finding')
    for result in results:
        numbers = (f'{number:,}' for number in (result.runs, result.branches, result.corpus))
        table.add_row(result.format, *numbers, 'yes' if result.finding else 'none')
    console.print(table)
    for result in results:
        if result.finding:
            console.print(f'{result.format}: {result.finding.data}', style='red')
            console.print(result.finding.what, markup=False)


def main(arguments: Sequence[str] | None = None) -> int:
    """Fuzz and print; returns the exit status: 1 with a finding, 2 without a fuzzer."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.fuzz_decoders', description='Fuzzes the decoders.'
    )
    parser.add_argument('--seconds', type=int, default=60, help='in all; default: %(default)s')
    parser.add_argument('--seed', type=int, default=1, help='default: %(default)s')
    parser.add_argument('--formats', nargs='+', choices=FORMAT_NAMES, default=FORMAT_NAMES)
    parser.add_argument('--json', type=Path, help='write all of it into this file, too')
    parser.add_argument('--format', choices=FORMAT_NAMES, help=argparse.SUPPRESS)
    options, rest = parser.parse_known_args(arguments)
    if options.format:
        fuzz(options.format, rest)
    console = Console(highlight=False)
    if rest:
        parser.error(f'unknown: {" ".join(rest)}')
    try:
        import atheris  # noqa: F401, PLC0415 -- there is none for some machines
    except ImportError:
        console.print('atheris is not installed: it needs x86_64 and Python 3.13 at most')
        return 2
    share_s = max(1, options.seconds // len(options.formats))
    with tempfile.TemporaryDirectory(prefix='fuzz-decoders-') as place:
        results = [run(name, share_s, options.seed, Path(place)) for name in options.formats]
    show(results, console)
    written = {
        'machine': machine()._asdict(),
        'versions': versions(is_local_kafka=False),
        'seed': options.seed,
        'seconds': options.seconds,
        'results': [
            result._asdict() | {'finding': result.finding and result.finding._asdict()}
            for result in results
        ],
    }
    write(options.json, written)
    return 1 if any(result.finding for result in results) else 0


if __name__ == '__main__':
    sys.exit(main())
