"""What the pages on the formats show is what the formats do."""

import json
import re
import shlex
from pathlib import Path
from typing import NamedTuple

import pytest
from ruamel.yaml import YAML
from typer.testing import CliRunner

from ros2_kafka_bridge.cli import app
from ros2_kafka_bridge.config.file import load
from ros2_kafka_bridge.config.formats import JsonSettings
from ros2_kafka_bridge.errors import DecodeError
from ros2_kafka_bridge.formats import FORMATS
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.message_types import load_layout

ROOT = Path(__file__).parents[3]
MESSAGES = ROOT / 'examples' / 'msgs'
PAGES = [ROOT / 'docs' / f'{name}.md' for name in ('formats', 'json', 'avro', 'protobuf')]
FENCED = re.compile(r'^```(\w*)\n(.*?)^```$', re.MULTILINE | re.DOTALL)
SCAN = load_layout('shelf_msgs/msg/ShelfScan', [MESSAGES])


class Block(NamedTuple):
    page: Path
    language: str
    text: str


def blocks(language: str, *names: str) -> list[Block]:
    return [
        Block(page, language, text)
        for page in PAGES
        if not names or page.stem in names
        for found, text in FENCED.findall(page.read_text())
        if found == language
    ]


def test_the_example_is_the_file_of_the_examples() -> None:
    text = (MESSAGES / 'shelf_msgs' / 'msg' / 'ShelfScan.msg').read_text()
    assert text in [block.text for block in blocks('', 'formats')]


@pytest.mark.parametrize('block', blocks('yaml'), ids=lambda block: block.page.stem)
def test_the_settings_that_are_shown_are_settings(block: Block, tmp_path: Path) -> None:
    yaml = YAML(typ='safe')
    shown = yaml.load(block.text)
    config = {'name': 'docs', 'kafka': {'bootstrap.servers': 'localhost:9092'}} | shown
    for route in config['routes']:
        if route['format'] in {'avro', 'protobuf'} and 'schema_registry' not in config:
            route.setdefault('schema', {'registry': False})
    file = tmp_path / 'bridge.yaml'
    with file.open('w') as stream:
        YAML().dump(config, stream)
    assert len(load(file, {}).routes) == len(shown['routes'])


COMMANDS = [
    line
    for block in blocks('sh')
    for line in block.text.splitlines()
    # tests/system/test_schema_from_graph.py has a graph.
    if line.startswith('ros2-kafka-bridge schema') and '--from-graph' not in line
]


@pytest.mark.parametrize('command', COMMANDS)
def test_the_schemas_that_are_shown_how_to_print_are_printed(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    arguments = shlex.split(command.replace('examples/msgs', str(MESSAGES)))[1:]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output


def test_the_record_of_json_is_one() -> None:
    [shown] = [block.text for block in blocks('json', 'json')]
    decode = FORMATS['json'].make_decode(SCAN, Scope('scans'))
    encode = FORMATS['json'].make_encode(SCAN, Scope('scans'))
    assert json.loads(encode(decode(shown.encode())) or b'') == json.loads(shown)


def test_the_errors_of_json_are_those_that_it_tells() -> None:
    [shown] = [block.text for block in blocks('json', 'json')]
    changes = [
        ('[12.5,', '["12",'),
        ('"side": 1,', ''),
        ('"side"', '"sides"'),
        ('"side": 1', '"side": 256'),
        ('[12.5,', '[1e39,'),
        ('9007199254740993', '18446744073709551616'),
    ]
    decode = FORMATS['json'].make_decode(SCAN, Scope('scans'))
    told = []
    for old, new in changes:
        with pytest.raises(DecodeError) as caught:
            decode(shown.replace(old, new).encode())
        told.append(str(caught.value))
    assert told == blocks('text', 'json')[0].text.splitlines()


def test_what_is_said_of_other_converters_is_what_it_tells() -> None:
    decode = FORMATS['json'].make_decode(
        SCAN, Scope('scans', JsonSettings(unknown='ignore', missing='default'))
    )
    records = (
        b'{"schema":{"type":"struct","optional":false,"fields":[]},"payload":{"side":1}}',
        b'\0\0\0\0\7{"side":1}',
        b'{"before":null,"after":{"side":1},"op":"c"}',
    )
    for record, told in zip(records, blocks('text', 'json')[1].text.splitlines(), strict=True):
        with pytest.raises(DecodeError) as caught:
            decode(record)
        assert str(caught.value).startswith(told.removesuffix('...'))
