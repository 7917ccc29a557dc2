"""What docs/protobuf.md shows is what the format does."""

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from google.protobuf import json_format
from typer.testing import CliRunner

from ros2_kafka_bridge.cli import app
from ros2_kafka_bridge.config.formats import SchemaSettings
from ros2_kafka_bridge.errors import DecodeError
from ros2_kafka_bridge.formats.protobuf import make_decode, make_encode
from ros2_kafka_bridge.formats.protobuf.schema import make_class, protobuf_schema
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.message_types import document, load_layout

ROOT = Path(__file__).parents[3]
MESSAGES = ROOT / 'examples' / 'msgs'
PAGE = (ROOT / 'docs' / 'protobuf.md').read_text()
PLAIN = Scope('scans', schema=SchemaSettings(registry=False))
SCAN = document(load_layout('shelf_msgs/msg/ShelfScan', [MESSAGES]), [MESSAGES])


def block(language: str) -> str:
    [text] = re.findall(rf'^```{language}\n(.*?)^```$', PAGE, re.MULTILINE | re.DOTALL)
    return str(text)


def record(**changes: Any) -> bytes:
    """The record of the page, with changes."""
    shown = json.loads(block('json')) | changes
    message = json_format.ParseDict(shown, make_class(SCAN)())
    written: bytes = message.SerializeToString()
    return written


def test_the_record_is_one() -> None:
    encoded = make_encode(SCAN, PLAIN)(make_decode(SCAN, PLAIN)(record()))
    message = make_class(SCAN).FromString(encoded)
    assert json_format.MessageToDict(message) == json.loads(block('json'))


def test_the_schema_is_a_part_of_the_one_that_is_used() -> None:
    whole = protobuf_schema(SCAN).splitlines()
    for line in block('proto').splitlines():
        pattern = re.escape(line).replace(r'\.\.\.', '.*')
        assert any(re.fullmatch(pattern, one) for one in whole), line


def test_the_commands_make_classes_that_the_reader_uses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    [printing, compiling] = block('sh').splitlines()
    arguments = shlex.split(printing.replace('examples/msgs', str(MESSAGES)))[1:]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    protoc = compiling.replace('protoc', f'{sys.executable} -m grpc_tools.protoc', 1)
    subprocess.run(['sh', '-ec', protoc], check=True)
    for folder in ('shelf_msgs', 'std_msgs', 'geometry_msgs', 'builtin_interfaces'):
        (tmp_path / folder / '__init__.py').touch()
    said = subprocess.run(
        [sys.executable, '-c', block('python')],
        input=record(),
        env={'PYTHONPATH': str(tmp_path)},
        capture_output=True,
        check=True,
    )
    assert said.stdout == b'A-07: 2 places weighed\n'


def test_the_errors_are_those_that_it_tells() -> None:
    wrong = [
        record(side=256),
        record(shelf='A' * 17),
        record(corners=[{}] * 5),
        # Field 3 of the header, behind the message.
        record() + b'\x0a\x02\x18\x01',
    ]
    told = []
    for value in wrong:
        with pytest.raises(DecodeError) as caught:
            make_decode(SCAN, PLAIN)(value)
        told.append(str(caught.value))
    assert told == block('text').splitlines()
