"""What docs/avro.md shows is what the format does."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from ros2_kafka_bridge.cli import app
from ros2_kafka_bridge.config.formats import SchemaSettings
from ros2_kafka_bridge.formats import FORMATS
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.message_types import load_layout

ROOT = Path(__file__).parents[3]
MESSAGES = ROOT / 'examples' / 'msgs'
SCAN = load_layout('shelf_msgs/msg/ShelfScan', [MESSAGES])
PLAIN = Scope('scans', schema=SchemaSettings(registry=False))


def block(page: str, language: str) -> str:
    text = (ROOT / 'docs' / page).read_text()
    return str(re.findall(rf'^```{language}\n(.*?)^```$', text, re.MULTILINE | re.DOTALL)[0])


def test_the_reader_that_is_shown_reads_the_record_that_is_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    command = block('avro.md', 'sh').replace('examples/msgs', str(MESSAGES))
    result = CliRunner().invoke(app, shlex.split(command)[1:])
    assert result.exit_code == 0, result.output
    # The record is that of the page on JSON, which is the same message.
    message = FORMATS['json'].make_decode(SCAN, PLAIN)(block('json.md', 'json').encode())
    said = subprocess.run(
        [sys.executable, '-c', block('avro.md', 'python')],
        input=FORMATS['avro'].make_encode(SCAN, PLAIN)(message),
        capture_output=True,
        check=True,
    )
    assert said.stdout.decode() == block('avro.md', 'text')
