"""The formats with schemas, end to end: real Kafka, real DDS, and a strict Schema Registry."""

import math
from array import array
from typing import Any, NamedTuple

from support.bridges.routes import lines
from support.formats.messages import cdr, exact_of, extremes, layout_of, new_message
from support.processes.harness import Bench, eventually, headers
from support.registry.server import RegistryServer
from support.ros.raw import reader_of, received

STRING = 'std_msgs/msg/String'
FLOAT64 = 'std_msgs/msg/Float64'


LARGEST = {'max_message_bytes': 8_000_000}


def header(frame: str) -> Any:
    stamp = new_message('builtin_interfaces/msg/Time', sec=1_700_000_000, nanosec=999_999_999)
    return new_message('std_msgs/msg/Header', stamp=stamp, frame_id=frame)


def image() -> bytes:
    """More than a megabyte, of every byte there is."""
    data = array('B', bytes(range(256)) * 4200)
    size = {'width': 640, 'height': 560, 'step': 1920}
    return cdr(
        'sensor_msgs/msg/Image', header=header('camera'), encoding='rgb8', data=data, **size
    )


def scan() -> bytes:
    ranges = [0.1, math.inf, -math.inf, math.nan, 3.4e38]
    return cdr('sensor_msgs/msg/LaserScan', header=header('lidar'), ranges=ranges)


def cloud() -> bytes:
    fields = [new_message('sensor_msgs/msg/PointField', name=name, count=1) for name in 'xyz']
    data = array('B', bytes(range(240)) * 500)
    return cdr('sensor_msgs/msg/PointCloud2', header=header('l'), fields=fields, data=data)


def markers() -> bytes:
    one = {'ns': 'shelves', 'text': 'A1', 'header': header('map')}
    many = [new_message('visualization_msgs/msg/Marker', id=n, **one) for n in range(30)]
    return cdr('visualization_msgs/msg/MarkerArray', markers=many)


def cases() -> dict[str, list[bytes]]:
    """Messages of different shape, by their types."""
    return {
        STRING: [cdr(STRING, data=text) for text in ('', 'shelf-7', 'Åkë 🤖 "\\\n')],
        'nav_msgs/msg/Odometry': [*extremes('nav_msgs/msg/Odometry')],
        'sensor_msgs/msg/JointState': [*extremes('sensor_msgs/msg/JointState')],
        'sensor_msgs/msg/BatteryState': [*extremes('sensor_msgs/msg/BatteryState')],
        'sensor_msgs/msg/Image': [image()],
        'sensor_msgs/msg/PointCloud2': [cloud()],
        'sensor_msgs/msg/LaserScan': [scan()],
        'visualization_msgs/msg/MarkerArray': [markers()],
        'nav_msgs/msg/Path': [*extremes('nav_msgs/msg/Path')],
        'diagnostic_msgs/msg/DiagnosticArray': [*extremes('diagnostic_msgs/msg/DiagnosticArray')],
        'nav_msgs/msg/OccupancyGrid': [*extremes('nav_msgs/msg/OccupancyGrid')],
        'test_msgs/msg/WStrings': [*extremes('test_msgs/msg/WStrings')],
        'test_msgs/msg/Defaults': [cdr('test_msgs/msg/Defaults')],
        'test_msgs/msg/Arrays': [*extremes('test_msgs/msg/Arrays')],
        'test_msgs/msg/BoundedSequences': [*extremes('test_msgs/msg/BoundedSequences')],
        'test_msgs/msg/Empty': [cdr('test_msgs/msg/Empty')],
    }


FEW = ('nav_msgs/msg/Odometry', 'sensor_msgs/msg/Image', 'test_msgs/msg/Arrays',
       'test_msgs/msg/WStrings')  # fmt: skip


class Line(NamedTuple):
    """One type on its way: out of one ROS topic into Kafka, and back to another."""

    bench: str
    number: int
    message_type: str
    format_name: str
    sent: list[bytes]

    @property
    def to_kafka(self) -> dict[str, Any]:
        """The route of the bridge at the publisher."""
        source = {'ros': f'/in{self.number}', 'type': self.message_type}
        return self._route(source, {'kafka': self.topic})

    @property
    def to_ros(self) -> dict[str, Any]:
        """The route of the bridge at the subscriber."""
        source = {'kafka': self.topic, 'start': 'earliest'}
        return self._route(source, {'ros': f'/out{self.number}', 'type': self.message_type})

    @property
    def topic(self) -> str:
        """The Kafka topic between the two."""
        return f'{self.bench}-{self.number}'

    def _route(self, source: dict[str, Any], sink: dict[str, Any]) -> dict[str, Any]:
        name = f'r{self.number}'
        return {'name': name, 'from': source, 'to': sink, 'format': self.format_name}


def test_what_is_published_comes_back_from_kafka_byte_for_byte_in_every_format(
    bench: Bench, registry: RegistryServer
) -> None:
    by_type = cases()
    chosen = [('json', kind, sent) for kind, sent in by_type.items()]
    chosen += [(name, kind, by_type[kind]) for name in ('avro', 'protobuf') for kind in FEW]
    ways = [
        Line(bench.name, number, kind, name, sent)
        for number, (name, kind, sent) in enumerate(chosen)
    ]
    for way in ways:
        bench.create_topic(way.topic, max_message_bytes='8000000')
    more = {
        'schema_registry': {'url': registry.url},
        'defaults': LARGEST,
        'kafka': bench.patient_kafka,
    }
    out = bench.config([way.to_kafka for way in ways], name=f'{bench.name}-out', **more)
    back = bench.config([way.to_ros for way in ways], name=f'{bench.name}-back', **more)
    came = [bench.place / f'{way.number}.received' for way in ways]
    (bench.place / 'read').write_text(
        ''.join(
            f'/out{way.number} {way.message_type} {file}\n'
            for way, file in zip(ways, came, strict=True)
        )
    )
    (bench.place / 'sent').write_text(
        ''.join(
            f'/in{way.number} {way.message_type} {one.hex()}\n' for way in ways for one in way.sent
        )
    )
    count = sum(len(way.sent) for way in ways)
    node = 'ros_node', '--durability', 'volatile'
    with (
        bench.peer(*node, '--take', str(bench.place / 'read')),
        bench.bridge(back) as reader,
        bench.bridge(out) as writer,
        bench.peer(*node, '--publish', str(bench.place / 'sent'), '--readers', '1'),
    ):
        eventually(
            lambda: sum(len(lines(file)) for file in came) >= count,
            90,
            lambda: f'{writer.output()}{reader.output()}',
        )
        assert writer.end() == 0, writer.output()
        assert reader.end() == 0, reader.output()
        checked, told, _ = bench.command('check', str(out), '--connect')
    assert f'subject {ways[-1].topic}-value of {registry.url} has the schema, with' in told
    assert told.count(' has the schema, with the id ') == 2 * len(FEW)
    assert checked == 0, told
    for way, file in zip(ways, came, strict=True):
        exact = exact_of(way.message_type)
        found = [exact(bytes.fromhex(line)) for line in lines(file)]
        assert found == way.sent, f'{way.format_name} {way.message_type}'


def test_a_bad_record_becomes_a_dead_letter_that_names_the_field_or_both_hashes(
    bench: Bench, topic_name: str
) -> None:
    own, other = layout_of(FLOAT64).type_hash or '', 'RIHS01_' + '0' * 64
    bench.create_topic(topic_name)
    route: dict[str, Any] = {
        'name': 'a',
        'from': {'kafka': topic_name, 'start': 'earliest'},
        'to': {'ros': '/out', 'type': FLOAT64},
        'format': 'json',
    }
    trusting = {
        **route,
        'name': 'b',
        'from': {'kafka': topic_name, 'start': 'earliest', 'dead_letter': f'{topic_name}.b'},
        'to': {'ros': '/b', 'type': FLOAT64},
        'check_type_hash': False,
        'min_subscribers': 0,
    }
    config = bench.config([route, trusting])
    with reader_of(bench, FLOAT64), bench.drained(config) as bridge:
        bench.produce(topic_name, [b'{"data": 1}', b'{"data": "one"}', b'{}', b'\xff', None])
        bench.produce(topic_name, [b'{"data": 2}'], headers=[('ros.type_hash', own.encode())])
        told = [('ros.type', FLOAT64.encode()), ('ros.type_hash', other.encode())]
        bench.produce(topic_name, [b'{"data": 3}'], headers=told)
        # One that a processor has copied from what it has read says nothing.
        copied = [('ros.type', b'my_msgs/msg/Distance'), ('ros.type_hash', other.encode())]
        bench.produce(topic_name, [b'{"data": 4}'], headers=copied)
        came = received(bench, 3, bridge, FLOAT64)
        letters = bench.records(f'{topic_name}.dead-letters', 5)
        assert bench.reaches(topic_name, 8)
        assert len(bench.records(f'{topic_name}.b', 4)) == 4
    assert came == [cdr(FLOAT64, data=float(number)) for number in (1, 2, 4)]
    errors = [headers(letter)['dead_letter.error'] for letter in letters]
    assert errors[0] == 'DecodeError: $.data: expected float, got str'
    assert errors[1] == 'DecodeError: $.data: is missing'
    assert errors[4].startswith(
        'DecodeError: ros.type_hash: the record was written with std_msgs/'
    )
    assert own in errors[4]
    assert other in errors[4]
