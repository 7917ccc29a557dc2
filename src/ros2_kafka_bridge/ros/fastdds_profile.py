"""The DDS profile of the bridge's own endpoints, made of the user's own and what it needs.

Fast DDS reads its settings from one XML file that an environment variable names. The bridge
needs, for its own topics only: a history of known length (confirmation is read from its room), a
short blocking time (publishing holds the interpreter lock), a quick heartbeat; and for the whole
process: no intra-process delivery (it stalls when a history is full), and no questions about the
types of others (nobody of a type is matched before the answer, and it is asked for only once). All
else stays as it is.
"""

import os
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

from ros2_kafka_bridge.errors import ConfigError, TransportError
from ros2_kafka_bridge.outside.files import UnreadableError, read_regular

NAMESPACE = 'http://www.eprosima.com'
_NS = f'{{{NAMESPACE}}}'
_BLOCKING_NS = 1_000_000
_HEARTBEAT_NS = 10_000_000
_TYPES = 'fastdds.type_propagation'
_FOLDER = 'ros2-kafka-bridge-'
_SHARED_MEMORY = '/dev/shm'  # noqa: S108 (a folder of its own is made there)

MARK_S = 864_197
"""A lifespan that nobody has by chance."""

_ALONE = frozenset({'profiles', 'types', 'log', 'library_settings'})
"""What Fast DDS also takes for the whole of a file."""


class Dialect(NamedTuple):
    """What differs between the versions of Fast DDS.

    Args:
        variable: Of the environment, names the file.
        heartbeat: Tag of a writer's heartbeat.
        asks_for_types: Whether nobody of an unknown type is matched before that has been told.
    """

    variable: str
    heartbeat: str
    asks_for_types: bool


FASTDDS_3 = Dialect('FASTDDS_DEFAULT_PROFILES_FILE', 'heartbeat_period', asks_for_types=True)
FASTDDS_2 = Dialect('FASTRTPS_DEFAULT_PROFILES_FILE', 'heartbeatPeriod', asks_for_types=False)


class Histories(NamedTuple):
    """How long the histories of the bridge's own endpoints are, and its lease.

    Args:
        writers: ROS topic -> samples of its writer's history.
        readers: ROS topic -> samples of its readers' caches.
        lease_s: How long others wait for a dead bridge; None leaves it as it is.
    """

    writers: Mapping[str, int]
    readers: Mapping[str, int]
    lease_s: float | None = None


def user_profile(environ: Mapping[str, str] | None = None) -> Path | None:
    """The profile file that the user's environment names, if any."""
    environ = os.environ if environ is None else environ
    names = (dialect.variable for dialect in (FASTDDS_3, FASTDDS_2))
    return next((Path(environ[name]) for name in names if environ.get(name)), None)


@contextmanager
def written(profile: str) -> Iterator[Path]:
    """A file with the profile, for as long as it is read.

    Where no folder for temporary files takes it, it lies in shared memory, which DDS uses anyway.

    Raises:
        TransportError: It can be written nowhere.
    """
    with ExitStack() as stack:
        try:
            file = _write(profile, None, stack)
        except OSError:
            file = _write_to_memory(profile, stack)
        yield file


def _write_to_memory(profile: str, stack: ExitStack) -> Path:
    try:
        return _write(profile, _SHARED_MEMORY, stack)
    except OSError as error:
        raise TransportError(
            f'ROS: no folder for temporary files can be written to, nor {_SHARED_MEMORY} '
            f'({error.strerror}), and Fast DDS reads its settings from a file: set TMPDIR to a '
            'folder that can be written to'
        ) from error


def _write(profile: str, place: str | None, stack: ExitStack) -> Path:
    folder = tempfile.TemporaryDirectory(prefix=_FOLDER, dir=place, ignore_cleanup_errors=True)
    file = Path(stack.enter_context(folder), 'profile.xml')
    file.write_text(profile, encoding='utf-8')
    return file


def make_profile(
    histories: Histories,
    user_file: Path | None = None,
    dialect: Dialect = FASTDDS_3,
    check_topic: str | None = None,
) -> str:
    """Write the XML of the profile.

    Args:
        histories: Of the endpoints.
        user_file: The user's own profile.
        dialect: Of the Fast DDS that reads it.
        check_topic: Its writer shows whether the profile counts, by a lifespan of `MARK_S`.

    Raises:
        ConfigError: The user's own file cannot be read.
    """
    root = ET.Element(f'{_NS}dds') if user_file is None else _read(user_file)
    settings = _child(root, 'library_settings', first=True)
    _child(settings, 'intraprocess_delivery').text = 'OFF'
    profiles = _child(root, 'profiles')
    for topic, samples in sorted(histories.writers.items()):
        _writer(_entry(profiles, 'data_writer', topic), samples, dialect)
    for topic, samples in sorted(histories.readers.items()):
        _limit(_entry(profiles, 'data_reader', topic), samples)
    if check_topic is not None:
        marked = _entry(profiles, 'data_writer', check_topic)
        _duration(_down(marked, 'qos', 'lifespan', 'duration'), MARK_S, 0)
    if dialect.asks_for_types:
        _ask_for_no_types(_participant(profiles))
    if histories.lease_s is not None:
        _lease(_participant(profiles), histories.lease_s)
    if not len(profiles):
        root.remove(profiles)  # Fast DDS takes an empty one for a mistake
    ET.register_namespace('', NAMESPACE)
    return ET.tostring(root, encoding='unicode', xml_declaration=True)


def discovery_protocol(user_file: Path) -> str:
    """How others are found with a user's profile, by Fast DDS's own name (`SIMPLE`, `CLIENT`).

    Raises:
        ConfigError: The file cannot be read.
    """
    users = _default_participant(_child(_read(user_file), 'profiles'))
    if users is None:
        return 'SIMPLE'
    if users.find(f'{_NS}rtps/{_NS}easy_mode_ip') is not None:
        return 'SUPER_CLIENT'
    way = ('rtps', 'builtin', 'discovery_config', 'discoveryProtocol')
    return users.findtext('/'.join(f'{_NS}{step}' for step in way)) or 'SIMPLE'


def _read(path: Path) -> ET.Element:
    try:
        root = ET.fromstring(read_regular(path))  # noqa: S314 (the user's own file)
    except (UnreadableError, LookupError, ValueError, ET.ParseError) as error:
        raise ConfigError([f'{path}: the DDS profile cannot be read: {error}']) from error
    for element in root.iter():
        # Fast DDS looks at no namespace: whichever is written, it is the one of ours.
        element.tag = f'{_NS}{_local(element)}'
    if root.tag == f'{_NS}dds':
        return root
    if _local(root) not in _ALONE:
        raise ConfigError(
            [f'{path}: the DDS profile begins with <{_local(root)}>, and should with <dds>']
        )
    outer = ET.Element(f'{_NS}dds')
    outer.append(root)
    return outer


def _local(element: ET.Element) -> str:
    return element.tag.rpartition('}')[2]


def _child(parent: ET.Element, name: str, *, first: bool = False) -> ET.Element:
    found = parent.find(f'{_NS}{name}')
    if found is None:
        found = ET.Element(f'{_NS}{name}')
        parent.insert(0 if first else len(parent), found)
    return found


def _down(parent: ET.Element, *names: str) -> ET.Element:
    for name in names:
        parent = _child(parent, name)
    return parent


def _entry(profiles: ET.Element, kind: str, topic: str) -> ET.Element:
    for element in profiles.findall(f'{_NS}{kind}'):
        if element.get('profile_name') == topic:
            return element
    return ET.SubElement(profiles, f'{_NS}{kind}', {'profile_name': topic})


def _limit(entry: ET.Element, samples: int) -> None:
    limits = _child(_child(entry, 'topic', first=True), 'resourceLimitsQos')
    for name, value in (
        ('max_samples', samples),
        ('max_instances', 1),
        ('max_samples_per_instance', samples),
        ('allocated_samples', min(samples, 100)),
    ):
        _child(limits, name).text = str(value)


def _writer(entry: ET.Element, samples: int, dialect: Dialect) -> None:
    _limit(entry, samples)
    reliability = _child(_child(entry, 'qos'), 'reliability')
    _child(reliability, 'kind').text = 'RELIABLE'
    _duration(_child(reliability, 'max_blocking_time'), 0, _BLOCKING_NS)
    _duration(_child(_child(entry, 'times'), dialect.heartbeat), 0, _HEARTBEAT_NS)


def _default_participant(profiles: ET.Element) -> ET.Element | None:
    for element in reversed(profiles.findall(f'{_NS}participant')):  # the last one counts
        if element.get('is_default_profile') == 'true':
            return element
    return None


def _participant(profiles: ET.Element) -> ET.Element:
    users = _default_participant(profiles)
    if users is not None:
        return users
    own = {'profile_name': 'ros2_kafka_bridge', 'is_default_profile': 'true'}
    profiles.insert(0, ET.Element(f'{_NS}participant', own))
    return profiles[0]


def _ask_for_no_types(participant: ET.Element) -> None:
    properties = _down(participant, 'rtps', 'propertiesPolicy', 'properties')
    if any(name.text == _TYPES for name in properties.iter(f'{_NS}name')):
        return
    added = ET.SubElement(properties, f'{_NS}property')
    _child(added, 'name').text = _TYPES
    _child(added, 'value').text = 'disabled'


def _lease(participant: ET.Element, lease_s: float) -> None:
    config = _down(participant, 'rtps', 'builtin', 'discovery_config')
    _duration(_child(config, 'leaseDuration'), *_split(lease_s))
    _duration(_child(config, 'leaseAnnouncement'), *_split(lease_s / 3))


def _split(seconds: float) -> tuple[int, int]:
    return int(seconds), int(seconds % 1 * 1e9)


def _duration(element: ET.Element, seconds: int, nanoseconds: int) -> None:
    _child(element, 'sec').text = str(seconds)
    _child(element, 'nanosec').text = str(nanoseconds)
