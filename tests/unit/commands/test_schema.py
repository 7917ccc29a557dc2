"""What `schema` prints: the schema that a format uses, without a broker and without ROS."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from support.ros.package import write_package

from ros2_kafka_bridge.commands.schema.report import SchemaOptions, report
from ros2_kafka_bridge.config.file import load
from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.formats.avro.schema import avro_schema
from ros2_kafka_bridge.message_types import document, load_layout

BATTERY = 'sensor_msgs/msg/BatteryState'
CONFIG = """\
name: b
kafka: {bootstrap.servers: x}
routes:
  - name: batteries
    from: {ros: /b, type: sensor_msgs/msg/BatteryState}
    to: {kafka: b}
    format: json
    json: {non_finite: 'null'}
  - name: open
    from: {ros: /o}
    to: {kafka: o}
    format: cdr
"""


def test_json_schema_tells_the_fields_with_their_docs(capsys: pytest.CaptureFixture[str]) -> None:
    assert report(SchemaOptions(BATTERY, 'json')) == 0
    printed = json.loads(capsys.readouterr().out)
    fields = printed['$defs']['sensor_msgs_msg_BatteryState']['properties']
    assert fields['voltage']['description'] == 'Voltage in Volts (Mandatory)'


def test_the_avro_schema_is_the_one_that_is_registered(capsys: pytest.CaptureFixture[str]) -> None:
    report(SchemaOptions(BATTERY, 'avro'))
    printed = json.loads(capsys.readouterr().out)
    assert printed == avro_schema(document(load_layout(BATTERY)))


def test_protobuf_is_written_as_the_files_that_a_compiler_wants(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report(SchemaOptions('std_msgs/msg/Header', 'protobuf', output=tmp_path))
    header = tmp_path / 'std_msgs/msg/Header.proto'
    assert 'import "builtin_interfaces/msg/Time.proto";' in header.read_text()
    assert str(header) in capsys.readouterr().out.splitlines()
    assert (tmp_path / 'builtin_interfaces/msg/Time.proto').is_file()


def test_a_route_says_type_format_and_settings(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / 'bridge.yaml'
    file.write_text(CONFIG)
    config = load(file, {})
    report(SchemaOptions('', '', config=config, route='batteries'))
    of_route = capsys.readouterr().out
    report(SchemaOptions(BATTERY, 'json'))
    assert '"null"' in of_route
    assert capsys.readouterr().out != of_route
    for asked, words in (
        (
            SchemaOptions('', '', config=config, route='open'),
            'cdr has no schema: say --format json',
        ),
        (
            SchemaOptions('', 'avro', config=config, route='open'),
            'open takes the type that is published: name a message type, or say --from-graph',
        ),
        (
            SchemaOptions('', '', config=config, route='battery'),
            "no route battery (did you mean 'bat",
        ),
        (SchemaOptions('', '', route='open'), '--config'),
        (SchemaOptions(BATTERY, ''), 'of which format'),
        (SchemaOptions('', 'json'), 'of which message type'),
        (SchemaOptions('std_msgs/msg/Strin', 'json'), 'did you mean std_msgs/msg/String'),
    ):
        with pytest.raises(ConfigError) as caught:
            report(asked)
        assert words in str(caught.value)


def test_a_type_from_a_folder_has_a_schema_without_being_built(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / 'acme_msgs' / 'msg').mkdir(parents=True)
    (tmp_path / 'acme_msgs/msg/Crane.msg').write_text(
        'float64 load  # How much it carries, in t.\n'
    )
    report(SchemaOptions('acme_msgs/msg/Crane', 'avro', [tmp_path]))
    [field] = json.loads(capsys.readouterr().out)['fields']
    assert (field['name'], field['doc']) == ('load', 'How much it carries, in t.')


def test_the_msg_definition_is_printed_as_recordings_hold_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert report(SchemaOptions('std_msgs/msg/Header', 'msg')) == 0
    printed = capsys.readouterr().out
    own, held = printed.split(f'{"=" * 80}\nMSG: builtin_interfaces/Time\n')
    assert 'builtin_interfaces/Time stamp\n' in own
    assert '# The seconds component, valid over all int32 values.\nint32 sec\n' in held


def test_written_msg_files_can_be_named_at_once_and_replace_no_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = SchemaOptions('std_msgs/msg/Header', 'msg', output=tmp_path)
    for _ in range(2):
        assert report(options) == 0
    assert load_layout('std_msgs/msg/Header', [tmp_path]) == load_layout('std_msgs/msg/Header')
    written = tmp_path / 'builtin_interfaces/msg/Time.msg'
    assert str(written) in capsys.readouterr().out
    (tmp_path / 'std_msgs/msg/Header.msg').unlink()
    written.write_text('int64 mine\n')
    with pytest.raises(ConfigError, match=r'Time\.msg: is there already, with another text'):
        report(options)
    assert written.read_text() == 'int64 mine\n'
    assert not (tmp_path / 'std_msgs/msg/Header.msg').exists()


def test_a_route_has_the_type_of_a_folder_unless_packages_are_imported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_package(tmp_path, 'sensor_msgs', {'BatteryState': 'uint8 BRIMFUL=1\nfloat32 volts\n'})
    file = tmp_path / 'bridge.yaml'
    for packages, line in (('as_needed', 'float32 volts'), ('import', 'float32 voltage')):
        file.write_text(CONFIG + f'ros: {{message_path: [{tmp_path}], packages: {packages}}}\n')
        config = load(file, {})
        report(SchemaOptions('', 'msg', config=config, route='batteries'))
        shown = capsys.readouterr()
        assert line in shown.out.splitlines()
        # Constants and comments are of that definition, too.
        assert ('BRIMFUL' in shown.out, 'Mandatory' in shown.out) == (
            packages == 'as_needed',
            packages == 'import',
        )
        said = f'{BATTERY} is described by {tmp_path}/{BATTERY}.msg\n'
        assert shown.err == said * (packages == 'as_needed')


def test_neither_ros_nor_a_client_of_kafka_is_loaded_for_it() -> None:
    script = (
        'import sys; sys.argv[1:] = ["schema", "std_msgs/msg/String", "--format", "json"]\n'
        'from ros2_kafka_bridge.cli import main\n'
        'try: main()\n'
        'except SystemExit as end: assert not end.code\n'
        'heavy = {"rclpy", "rosidl_runtime_py", "confluent_kafka", "fastavro", "httpx"}\n'
        'assert not heavy & set(sys.modules), heavy & set(sys.modules)\n'
    )
    done = subprocess.run([sys.executable, '-c', script], capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)
