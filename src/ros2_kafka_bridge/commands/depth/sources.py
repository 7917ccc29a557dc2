"""What `depth` measures with: records of Kafka, a live ROS topic, or files."""

import logging
import os
import re
import time
from typing import NamedTuple

import numpy as np

from ros2_kafka_bridge.commands.depth.options import DepthOptions, Kafka, Ros
from ros2_kafka_bridge.commands.options import LOCAL
from ros2_kafka_bridge.commands.screen import waiting
from ros2_kafka_bridge.config.settings import QoS, RosSettings
from ros2_kafka_bridge.depth.queue import SEED, Times
from ros2_kafka_bridge.depth.recording import Reader, read_arrivals, read_recording, read_service
from ros2_kafka_bridge.errors import ConfigError, RouteError
from ros2_kafka_bridge.kafka.properties import PropertyValue, consumer_properties, refusal
from ros2_kafka_bridge.kafka.property_check import property_problems
from ros2_kafka_bridge.kafka.timestamps import read_timestamps
from ros2_kafka_bridge.logs.text import count
from ros2_kafka_bridge.process.load import load_checked
from ros2_kafka_bridge.ros.arrivals import Arrivals
from ros2_kafka_bridge.ros.discovery import hint
from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.node import RosNode, domain_in_words, open_node
from ros2_kafka_bridge.ros.source import RosSource
from ros2_kafka_bridge.ros.topic_end import TopicEnd
from ros2_kafka_bridge.ros.topic_reader import TopicReader
from ros2_kafka_bridge.ros.types import MessageType
from ros2_kafka_bridge.ros.used_type import RosEnd, RouteTypes
from ros2_kafka_bridge.threads.wakeup import Wakeup

_KAFKA_TIMES = (
    'Kafka keeps milliseconds: records of one millisecond are taken for a burst; and between '
    'these times and the reader lies what carries them (the bridge, DDS)'
)
_BY_GAPS = (
    'by the gaps in their numbers: the publisher is KEEP_LAST or best effort, and its bursts may '
    'be larger than seen'
)
_AT_ONCE = (
    'an idle reader is taken to begin at once; a real one has to wake up, and meanwhile a burst '
    'fills its queue: say how long with --wake (as 0.2ms), or measure it with ServiceTimes'
)
_TYPE_S = 10.0
_FIRST_S = 5.0
_STEP_S = 0.1
_BATCH = 500
_SAMPLES = 5000
_UNITS_NS = {'ns': 1.0, 'us': 1e3, 'µs': 1e3, 'ms': 1e6, 's': 1e9}


class Traffic(NamedTuple):
    """Arrivals, and what is to be known of them.

    Args:
        where: What they are of, in a few words.
        arrivals_ns: In order.
        notes: A sentence each.
    """

    where: str
    arrivals_ns: Times
    notes: tuple[str, ...]


def measured(options: DepthOptions) -> tuple[Traffic, Reader]:
    """Arrivals, and how fast the reader is.

    Raises:
        BridgeError: A file is not what it should be, or the topic cannot be read.
    """
    # Files first: a mistake in one is not told after half a minute of listening.
    reader = _reader(options)
    traffic = _traffic(options)
    service = reader.service_ns
    if not isinstance(service, int) and len(service) != len(traffic.arrivals_ns):
        drawn = (
            f'service times are drawn in blocks from {len(service):,} recorded ones (seed {SEED})'
        )
        reader = reader._replace(notes=(*reader.notes, drawn))
    return traffic, reader


def _reader(options: DepthOptions) -> Reader:
    file = options.recording or options.service_file
    if file is None:
        reader = Reader(_duration_ns('--service', options.service), 0, ())
    else:
        reader = read_service(file)
    if options.wake:
        return reader._replace(wake_ns=_duration_ns('--wake', options.wake))
    if isinstance(reader.wake_ns, int):
        return reader._replace(notes=(*reader.notes, _AT_ONCE))
    return reader


def _traffic(options: DepthOptions) -> Traffic:
    if options.kafka is not None:
        return _from_kafka(options.kafka)
    if options.ros is not None:
        return _from_ros(options.ros)
    if options.recording is not None:
        return Traffic(str(options.recording), read_recording(options.recording).arrivals_ns, ())
    assert options.arrivals is not None, 'one source is given'
    return Traffic(str(options.arrivals), read_arrivals(options.arrivals), ())


def _duration_ns(option: str, text: str) -> int:
    found = re.fullmatch(r'\s*([0-9.]+(?:e-?\d+)?)\s*(ns|us|µs|ms|s)\s*', text)
    try:
        if found:
            return round(float(found[1]) * _UNITS_NS[found[2]])
    except ValueError:
        pass
    raise ConfigError([f'{option}: {text!r} is not a time with its unit (0.8ms, 250us, 1s)'])


def _from_kafka(asked: Kafka) -> Traffic:
    """Read the timestamps of the last records of a topic; nothing is committed.

    Raises:
        BridgeError: A property is wrong, or the topic cannot be read.
    """
    # No group is ever joined: librdkafka asks for a name only.
    properties = consumer_properties(_properties(asked), group='depth', client_id='depth')
    with waiting(f'Reading {asked.topic}'):
        found = read_timestamps(properties, asked.topic, asked.last, asked.partition)
    notes = [_KAFKA_TIMES]
    if found.by_broker:
        notes.append(
            'the broker has stamped these records (LogAppendTime), a whole batch at once: bursts '
            'may be larger than what was sent'
        )
    if not found.in_order:
        notes.append('timestamps were not in order, and are sorted')
    if found.partitions > 1:
        notes.append(f'{found.partitions} partitions are taken together, as one reader gets them')
    where = asked.topic if asked.partition is None else f'{asked.topic}[{asked.partition}]'
    return Traffic(
        f'Kafka topic {where}', np.array(found.times_ms, np.int64) * 1_000_000, tuple(notes)
    )


def _properties(asked: Kafka) -> dict[str, PropertyValue]:
    given = dict(_split(text) for text in asked.properties)
    wrong = [f'-X {name}: {reason}' for name in given if (reason := refusal(name))]
    wrong += [f'-X {name}: {problem}' for name, problem in property_problems(given).items()]
    if wrong:
        raise ConfigError(wrong)
    configured: dict[str, PropertyValue] = {}
    if asked.config is not None:
        configured = dict(load_checked(asked.config).kafka)
    servers = {'bootstrap.servers': asked.servers} if asked.servers else {}
    return {'bootstrap.servers': LOCAL, **configured, **servers, **given}


def _split(text: str) -> tuple[str, str]:
    name, equals, value = text.partition('=')
    if not equals or not name:
        raise ConfigError([f'-X {text}: is not of the form name=value'])
    return name.strip(), value


def _from_ros(asked: Ros) -> Traffic:
    """Watch a live topic: source timestamps of its messages, read raw with KEEP_ALL.

    Raises:
        BridgeError: ROS is not here, nobody publishes on the topic, or its type is not known.
    """
    log = logging.LoggerAdapter(logging.getLogger(__name__))
    histories = Histories({}, {asked.topic: _SAMPLES})
    with open_node(f'depth_{os.getpid()}', None, histories) as node:
        end = TopicEnd(node, asked.topic, _type(node, asked.topic), QoS(), log)
        arrivals = Arrivals(Wakeup())
        source = RosSource(arrivals, {asked.topic: TopicReader(end, arrivals)})
        source.open()
        try:
            with waiting(f'Listening to {asked.topic} ({asked.seconds:g} s)'):
                times_ns = _listen(source, asked.seconds)
            lost = source.lost_upstream
        finally:
            source.close()
    notes: tuple[str, ...] = ()
    if lost:
        notes = (f'{count(lost, "message")} never came here, {_BY_GAPS}',)
    return Traffic(f'ROS topic {asked.topic}', np.sort(np.array(times_ns, np.int64)), notes)


def _type(node: RosNode, topic: str) -> MessageType:
    deadline_s = time.monotonic() + _TYPE_S

    def too_long(pause_s: float) -> bool:
        time.sleep(pause_s)
        return time.monotonic() > deadline_s

    types = RouteTypes(node, RosSettings())
    with waiting(f'Waiting for a publisher of {topic}'):
        wanted = types.find(RosEnd(topic), too_long)
        loaded = None if wanted is None else types.loader.load(wanted)
    if loaded is None:
        why = hint('is it the domain of the nodes, do they run?')
        raise RouteError(f'nobody is seen to publish {topic} in {domain_in_words(None)}: {why}')
    return loaded


def _listen(source: RosSource, seconds: float) -> list[int]:
    """Source timestamps of what is published meanwhile; the time begins with the first message."""
    since_ns = time.time_ns()
    times_ns: list[int] = []
    end_s = time.monotonic() + max(_FIRST_S, seconds)
    while (left_s := end_s - time.monotonic()) > 0:
        for message in source.take(_BATCH, min(_STEP_S, left_s)):
            # A latched publisher sends what it had said before.
            if message.source_time_ns >= since_ns:
                end_s = end_s if times_ns else time.monotonic() + seconds
                times_ns.append(message.source_time_ns)
    return times_ns
