"""The DDS profile keeps what the user wrote, and adds what the bridge needs."""

import tempfile
import xml.etree.ElementTree as ET
from importlib.resources import files
from pathlib import Path

import pytest

from ros2_kafka_bridge.errors import ConfigError, TransportError
from ros2_kafka_bridge.ros import fastdds_profile
from ros2_kafka_bridge.ros.fastdds_profile import (
    FASTDDS_2,
    NAMESPACE,
    Histories,
    make_profile,
    user_profile,
    written,
)

PAGE = Path(__file__).parents[3] / 'docs' / 'troubleshooting.md'
NAMES = {'d': NAMESPACE}
ORDERS = Histories({'/orders': 500}, {'/returned': 2000})

PARTICIPANT = """
    <participant profile_name="mine" is_default_profile="true">
      <rtps><name>robot 7</name></rtps>
    </participant>"""
WRITER = """
    <data_writer profile_name="/orders">
      <qos><publishMode><kind>ASYNCHRONOUS</kind></publishMode></qos>
      <historyMemoryPolicy>DYNAMIC</historyMemoryPolicy>
    </data_writer>"""


def profile(histories: Histories, file: Path | None = None) -> ET.Element:
    """The profile, read again."""
    return ET.fromstring(make_profile(histories, file))  # noqa: S314 (our own)


def text(root: ET.Element, path: str) -> str | None:
    """The text at a path such as `profiles/participant`, one step of the user's namespace each."""
    return root.findtext('/'.join(f'd:{step}' for step in path.split('/')), namespaces=NAMES)


def entries(root: ET.Element, kind: str) -> list[str | None]:
    """The profiles of a kind, by their names."""
    return [entry.get('profile_name') for entry in root.findall(f'.//d:{kind}', NAMES)]


def write(place: Path, content: str) -> Path:
    """A user's file."""
    file = place / 'profile.xml'
    file.write_text(content)
    return file


def test_without_a_file_it_holds_the_bridges_endpoints() -> None:
    root = profile(ORDERS)
    assert root.tag == f'{{{NAMESPACE}}}dds'
    assert text(root, 'library_settings/intraprocess_delivery') == 'OFF'
    writer, reader = 'profiles/data_writer/', 'profiles/data_reader/'
    assert text(root, f'{writer}topic/resourceLimitsQos/max_samples') == '500'
    assert text(root, f'{writer}qos/reliability/max_blocking_time/nanosec') == '1000000'
    assert text(root, f'{writer}times/heartbeat_period/nanosec') == '10000000'
    assert text(root, f'{reader}topic/resourceLimitsQos/max_samples') == '2000'
    assert entries(root, 'data_writer') == ['/orders']
    assert entries(root, 'data_reader') == ['/returned']


@pytest.mark.parametrize(
    'content',
    [
        f'<dds xmlns="{NAMESPACE}"><profiles>{PARTICIPANT}</profiles></dds>',
        f'<dds><profiles>{PARTICIPANT}</profiles></dds>',
        f'<profiles xmlns="{NAMESPACE}">{PARTICIPANT}</profiles>',
        f'<profiles>{PARTICIPANT}</profiles>',
        # As in most files that are to be found: Fast DDS looks at no namespace.
        f'<profiles xmlns="{NAMESPACE}/XMLSchemas/fastRTPS_Profiles">{PARTICIPANT}</profiles>',
        f'<dds xmlns="{NAMESPACE}/fastRTPS_Profiles"><profiles>{PARTICIPANT}</profiles></dds>',
        f'<d:dds xmlns:d="urn:any"><profiles xmlns="">{PARTICIPANT}</profiles></d:dds>',
    ],
    ids=[
        'dds',
        'dds without namespace',
        'profiles',
        'profiles without namespace',
        'profiles of another namespace',
        'dds of another namespace',
        'dds of several namespaces',
    ],
)
def test_the_users_participant_stays_whatever_the_root(content: str, tmp_path: Path) -> None:
    root = profile(ORDERS, write(tmp_path, f'<?xml version="1.0" encoding="UTF-8"?>{content}'))
    assert root.tag == f'{{{NAMESPACE}}}dds'
    assert len(root.findall('d:profiles', NAMES)) == 1
    assert entries(root, 'participant') == ['mine']
    assert text(root, 'profiles/participant/rtps/name') == 'robot 7'
    assert text(root, 'library_settings/intraprocess_delivery') == 'OFF'
    assert entries(root, 'data_writer') == ['/orders']


def test_the_users_entry_for_the_same_topic_is_kept_and_completed(tmp_path: Path) -> None:
    file = write(tmp_path, f'<dds><profiles>{WRITER}</profiles></dds>')
    root = profile(ORDERS, file)
    assert entries(root, 'data_writer') == ['/orders']
    writer = 'profiles/data_writer/'
    assert text(root, f'{writer}qos/publishMode/kind') == 'ASYNCHRONOUS'
    assert text(root, f'{writer}historyMemoryPolicy') == 'DYNAMIC'
    assert text(root, f'{writer}topic/resourceLimitsQos/max_samples') == '500'
    assert text(root, f'{writer}qos/reliability/kind') == 'RELIABLE'


def test_the_users_intra_process_delivery_is_turned_off(tmp_path: Path) -> None:
    content = '<dds><library_settings><intraprocess_delivery>FULL</intraprocess_delivery>'
    root = profile(ORDERS, write(tmp_path, f'{content}</library_settings></dds>'))
    assert text(root, 'library_settings/intraprocess_delivery') == 'OFF'
    assert len(root.findall('d:library_settings', NAMES)) == 1


LEASE = 'profiles/participant/rtps/builtin/discovery_config/leaseDuration/'


def test_a_lease_is_written_only_when_given() -> None:
    root = profile(ORDERS._replace(lease_s=4.5))
    assert (text(root, f'{LEASE}sec'), text(root, f'{LEASE}nanosec')) == ('4', '500000000')
    assert text(profile(ORDERS), f'{LEASE}sec') is None


def test_a_lease_goes_into_the_users_own_participant(tmp_path: Path) -> None:
    file = write(tmp_path, f'<dds><profiles>{PARTICIPANT}</profiles></dds>')
    root = profile(ORDERS._replace(lease_s=4), file)
    assert entries(root, 'participant') == ['mine']
    assert text(root, 'profiles/participant/rtps/name') == 'robot 7'
    assert text(root, f'{LEASE}sec') == '4'


def propagation(root: ET.Element) -> list[tuple[str | None, str | None]]:
    """The properties of the default participant, by name and value."""
    [participant] = root.findall('d:profiles/d:participant[@is_default_profile="true"]', NAMES)
    properties = participant.findall('d:rtps/d:propertiesPolicy/d:properties/d:property', NAMES)
    return [(text(one, 'name'), text(one, 'value')) for one in properties]


@pytest.mark.parametrize(
    'made',
    [
        make_profile(Histories({}, {})),
        (files('ros2_kafka_warehouse') / 'data/fastdds.xml').read_text(),
        PAGE.read_text().partition('```xml\n')[2].partition('```')[0],
    ],
    ids=['of the bridge', 'of the warehouse', 'of the docs'],
)
def test_no_reader_waits_until_a_publisher_has_told_its_type(made: str) -> None:
    root = ET.fromstring(made)  # noqa: S314 (our own)
    assert propagation(root) == [('fastdds.type_propagation', 'disabled')]


@pytest.mark.parametrize('wish', ['enabled', 'disabled', 'minimal_bandwidth'])
def test_a_users_own_wish_about_types_counts(wish: str, tmp_path: Path) -> None:
    wishes = [('fastdds.max_message_size', '1000'), ('fastdds.type_propagation', wish)]
    assert propagation(profile(ORDERS, with_properties(tmp_path, wishes))) == wishes


def test_the_other_properties_of_the_users_participant_stay(tmp_path: Path) -> None:
    other = ('fastdds.max_message_size', '1000')
    root = profile(ORDERS, with_properties(tmp_path, [other]))
    assert propagation(root) == [other, ('fastdds.type_propagation', 'disabled')]


def test_of_two_default_participants_the_last_counts_as_for_fast_dds(tmp_path: Path) -> None:
    two = PARTICIPANT + PARTICIPANT.replace('mine', 'last')
    root = profile(ORDERS._replace(lease_s=4), write(tmp_path, f'<profiles>{two}</profiles>'))
    first, last = root.findall('d:profiles/d:participant', NAMES)
    assert 'leaseDuration' not in ET.tostring(first, encoding='unicode')
    assert 'leaseDuration' in ET.tostring(last, encoding='unicode')
    assert 'type_propagation' in ET.tostring(last, encoding='unicode')


def with_properties(place: Path, properties: list[tuple[str, str]]) -> Path:
    """A user's file whose default participant has properties."""
    made = ''.join(
        f'<property><name>{name}</name><value>{value}</value></property>'
        for name, value in properties
    )
    policy = f'<propertiesPolicy><properties>{made}</properties></propertiesPolicy>'
    participant = PARTICIPANT.replace('</name></rtps>', f'</name>{policy}</rtps>')
    return write(place, f'<dds><profiles>{participant}</profiles></dds>')


def test_fast_dds_2_asks_for_no_types_and_knows_no_such_property() -> None:
    made = make_profile(ORDERS, dialect=FASTDDS_2)
    assert 'type_propagation' not in made
    assert 'participant' not in made


@pytest.mark.parametrize(
    ('content', 'reason'),
    [
        (None, 'no such file'),
        (b'', 'no element found'),
        (b'<dds>', 'no element found'),
        (b'\xff\xfe\xfd', 'unclosed token'),
        (b'<dds>\xe9</dds>', 'not well-formed'),
        (b'<?xml version="1.0" encoding="klingon"?><dds/>', 'unknown encoding'),
    ],
)
def test_a_file_that_cannot_be_read_is_a_mistake_of_the_configuration(
    content: bytes | None, reason: str, tmp_path: Path
) -> None:
    file = tmp_path / 'profile.xml'
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(ConfigError, match=reason) as caught:
        make_profile(ORDERS, file)
    [problem] = caught.value.problems
    assert problem.startswith(f'{file}: the DDS profile cannot be read: ')


def test_a_file_may_be_in_any_encoding_that_it_names(tmp_path: Path) -> None:
    file = tmp_path / 'profile.xml'
    xml = '<?xml version="1.0" encoding="UTF-16"?><profiles>{}</profiles>'
    file.write_bytes(xml.format(PARTICIPANT.replace('robot 7', 'Roboter fünf')).encode('utf-16'))
    assert text(profile(ORDERS, file), 'profiles/participant/rtps/name') == 'Roboter fünf'


def test_a_file_that_is_no_profile_is_a_mistake_of_the_configuration(tmp_path: Path) -> None:
    file = write(tmp_path, '<CycloneDDS xmlns="https://cdds.io/config"/>')
    with pytest.raises(
        ConfigError, match=r'profile\.xml: .* begins with <CycloneDDS>, and should'
    ):
        make_profile(ORDERS, file)


@pytest.mark.parametrize('kind', ['types', 'log', 'library_settings'])
def test_a_file_of_one_kind_of_setting_is_kept(kind: str, tmp_path: Path) -> None:
    root = profile(ORDERS, write(tmp_path, f'<{kind}/>'))
    assert root.find(f'd:{kind}', NAMES) is not None
    assert entries(root, 'data_writer') == ['/orders']


def test_the_users_file_is_what_either_variable_names() -> None:
    new, old = 'FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE'
    assert user_profile({}) is None
    assert user_profile({old: '/old.xml'}) == Path('/old.xml')
    assert user_profile({old: '/old.xml', new: '/new.xml'}) == Path('/new.xml')
    assert user_profile({new: ''}) is None


def test_where_no_folder_for_temporary_files_can_be_written_it_lies_in_shared_memory(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(tempfile, 'tempdir', '/proc')
    with written('<a/>') as file:
        assert file.read_text() == '<a/>'
        assert file.is_relative_to(fastdds_profile._SHARED_MEMORY)
    assert not file.parent.exists()


def test_where_it_can_be_written_nowhere_the_cure_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(tempfile, 'tempdir', '/proc')
    monkeypatch.setattr(fastdds_profile, '_SHARED_MEMORY', '/proc')
    with pytest.raises(TransportError, match=r'nor /proc \(No such file.*TMPDIR'), written('<a/>'):
        pytest.fail('there is no file')
