"""The Protobuf schemas of message types, held against the real protoc."""

import subprocess
import sys
from pathlib import Path

import pytest
from confluent_kafka.schema_registry.confluent import meta_pb2
from google.protobuf import descriptor_pool, json_format
from google.protobuf.descriptor_pb2 import DescriptorProto, FileDescriptorProto, FileDescriptorSet
from support.formats.messages import cdr_of, new_message
from support.processes.terminal import finished

from ros2_kafka_bridge.config.formats import SchemaSettings
from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.formats.protobuf import make_decode, make_encode
from ros2_kafka_bridge.formats.protobuf.schema import (
    make_class,
    make_files,
    protobuf_schema,
    protobuf_sources,
)
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.message_types import document, load_layout, type_names
from ros2_kafka_bridge.message_types.layout import Constant, Field, Kind, Layout, Primitive, String

PLAIN = Scope('robots', schema=SchemaSettings(registry=False))
INT8 = Primitive('int8')


def compiled(sources: dict[str, str], folder: Path) -> dict[str, FileDescriptorProto]:
    """What the real protoc makes of these files."""
    written(sources, folder)
    protoc(folder, f'--descriptor_set_out={folder}/all', '--include_imports', *sources)
    made = FileDescriptorSet.FromString((folder / 'all').read_bytes())
    return {file.name: without_default_json_names(file) for file in made.file}


def written(sources: dict[str, str], folder: Path) -> None:
    for name, text in sources.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding='utf-8')


def protoc(folder: Path, *words: str) -> None:
    result = finished([sys.executable, '-m', 'grpc_tools.protoc', f'-I{folder}', *words])
    assert result.returncode == 0, result.stderr
    assert result.stderr == ''


def without_default_json_names(file: FileDescriptorProto) -> FileDescriptorProto:
    """As schemas are: protoc writes out the names that it would take itself."""
    for message in file.message_type:
        _drop_default_json_names(message)
    for extension in file.extension:
        extension.ClearField('json_name')
    return file


def _drop_default_json_names(message: DescriptorProto) -> None:
    for field in message.field:
        first, *others = field.name.split('_')
        if field.json_name == first + ''.join(word.capitalize() for word in others):
            field.ClearField('json_name')
    for nested in message.nested_type:
        _drop_default_json_names(nested)


def layout(name: str, *fields: tuple[str, Kind]) -> Layout:
    return Layout(name, tuple(Field(*field) for field in fields))


def test_protoc_reads_every_installed_type_as_the_schema_that_is_registered(
    tmp_path: Path,
) -> None:
    sources: dict[str, str] = {}
    ours: dict[str, FileDescriptorProto] = {}
    for name in type_names():
        loaded = document(load_layout(name))
        sources |= protobuf_sources(loaded)
        ours |= {file.name: file for file in make_files(loaded)}
    theirs = compiled(sources, tmp_path)
    assert len(ours) >= 170
    assert {name: theirs[name] for name in ours} == ours


def test_the_file_of_confluent_is_printed_as_it_is(tmp_path: Path) -> None:
    theirs = compiled(protobuf_sources(load_layout('std_msgs/msg/Header')), tmp_path)
    assert theirs['confluent/meta.proto'].SerializeToString() == meta_pb2.DESCRIPTOR.serialized_pb


def test_a_schema_has_the_hash_the_docs_and_the_constants_of_its_type() -> None:
    loaded = document(load_layout('sensor_msgs/msg/BatteryState'))
    [message] = make_files(loaded)[-1].message_type
    meta = message.options.Extensions[meta_pb2.message_meta]  # type: ignore[attr-defined]
    assert meta.params['ros.type_hash'] == loaded.type_hash
    assert (loaded.type_hash or '').startswith('RIHS01_')
    assert 'uint8 POWER_SUPPLY_STATUS_CHARGING = 1' in meta.doc
    voltage = next(field for field in message.field if field.name == 'voltage')
    field_meta = voltage.options.Extensions[meta_pb2.field_meta]  # type: ignore[attr-defined]
    assert 'Voltage in Volts' in field_meta.doc
    assert '  // Voltage in Volts' in protobuf_schema(loaded)


def test_a_field_says_its_ros_type_where_that_is_narrower() -> None:
    text = protobuf_schema(load_layout('geometry_msgs/msg/PoseWithCovariance'))
    assert 'params: [{ key: "ros.type", value: "float64[36]" }]' in text
    text = protobuf_schema(load_layout('sensor_msgs/msg/PointField'))
    assert 'params: [{ key: "ros.type", value: "uint8" }]' in text


def test_the_own_file_is_printed_first_and_each_one_once() -> None:
    text = protobuf_schema(load_layout('nav_msgs/msg/Odometry'))
    assert text.startswith('// ----- nav_msgs/msg/Odometry.proto -----\n\nsyntax = "proto3";\n')
    assert text.count('// ----- geometry_msgs/msg/Vector3.proto -----') == 1
    assert text.count('// ----- confluent/meta.proto -----') == 1


def test_types_with_one_short_name_do_not_clash(tmp_path: Path) -> None:
    one = layout('one/msg/Status', ('level', INT8))
    two = layout('two/msg/Status', ('level', String()))
    both = layout('one/msg/Both', ('one', one), ('two', two))
    [message] = compiled(protobuf_sources(both), tmp_path)['one/msg/Both.proto'].message_type
    assert [field.type_name for field in message.field] == ['.one.msg.Status', '.two.msg.Status']


def test_fields_may_have_the_names_of_packages_and_of_words_of_protobuf_and_python(
    tmp_path: Path,
) -> None:
    header = layout('std_msgs/msg/Header', ('from', INT8), ('import', INT8))
    words = ('message', 'repeated', 'option', 'reserved', 'std_msgs', 'msg', 'int32', 'class')
    odd = layout('message/msg/Odd', ('message_', header), *((word, INT8) for word in words))
    theirs = compiled(protobuf_sources(odd), tmp_path)
    assert theirs['message/msg/Odd.proto'] == make_files(odd)[-1]
    made = make_class(odd)()
    setattr(made, 'class', -1)
    assert json_format.MessageToDict(made) == {'class': -1}


def test_fields_that_json_would_confuse_keep_their_names(tmp_path: Path) -> None:
    joints = layout('robot/msg/Joints', ('joint_1', INT8), ('joint1', INT8))
    theirs = compiled(protobuf_sources(joints), tmp_path)
    assert theirs['robot/msg/Joints.proto'] == make_files(joints)[-1]
    made = make_class(joints)(joint_1=1, joint1=2)
    assert json_format.MessageToDict(made) == {'joint_1': 1, 'joint1': 2}


def test_docs_may_hold_anything(tmp_path: Path) -> None:
    doc = 'Says "no" \\ and */ ends;\n\n  in °C\t\x00\x07\u2028日本\r\nlast'
    odd = Layout(
        'robot/msg/Odd',
        (Field('temperature', Primitive('float32'), doc=doc),),
        constants=(Constant('NAME', String(), 'a "b"\n'), Constant('MANY', INT8, -3, 'of\nthem')),
        doc=doc,
        type_hash='RIHS01_' + 'a' * 64,
    )
    theirs = compiled(protobuf_sources(odd), tmp_path)
    assert theirs['robot/msg/Odd.proto'] == make_files(odd)[-1]


def test_a_name_that_protobuf_cannot_have_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"robot/msg/Odd: .* cannot carry the name 'größe'"):
        make_class(layout('robot/msg/Odd', ('größe', INT8)))


def test_the_pool_of_the_process_is_left_alone() -> None:
    odd = layout('std_msgs/msg/String', ('of_mine', INT8))
    assert make_class(load_layout('std_msgs/msg/String')) is not make_class(odd)
    with pytest.raises(KeyError):
        descriptor_pool.Default().FindMessageTypeByName('std_msgs.msg.String')


READER_AND_WRITER = """
import sys
from google.protobuf import json_format
from geometry_msgs.msg.PoseStamped_pb2 import PoseStamped
pose = PoseStamped.FromString(sys.stdin.buffer.read())
assert json_format.MessageToDict(pose)['header'] == {'stamp': {}, 'frame_id': 'map'}, pose
pose.pose.position.x = -0.5
sys.stdout.buffer.write(pose.SerializeToString())
"""


def test_classes_that_protoc_makes_of_the_printed_schema_read_and_write_records(
    tmp_path: Path,
) -> None:
    name = 'geometry_msgs/msg/PoseStamped'
    loaded = document(load_layout(name))
    sources = protobuf_sources(loaded)
    written(sources, tmp_path)
    protoc(tmp_path, f'--python_out={tmp_path}', *sources)
    for folder in ('geometry_msgs', 'std_msgs', 'builtin_interfaces'):
        # Else the packages of ROS with these names would be found instead.
        (tmp_path / folder / '__init__.py').touch()
    pose = new_message(name)
    pose.header.frame_id = 'map'
    result = subprocess.run(
        [sys.executable, '-c', READER_AND_WRITER],
        input=make_encode(loaded, PLAIN)(cdr_of(pose, name)),
        env={'PYTHONPATH': str(tmp_path)},
        capture_output=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr.decode()
    pose.pose.position.x = -0.5
    assert make_decode(loaded, PLAIN)(result.stdout) == cdr_of(pose, name)
