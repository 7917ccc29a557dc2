"""Whether the ROS graph shows all who are there, and what to do where it does not."""

from pathlib import Path

import pytest

from ros2_kafka_bridge.ros import discovery
from ros2_kafka_bridge.ros.discovery import partial_view, waits_for_type, why_nobody
from ros2_kafka_bridge.ros.fastdds_profile import FASTDDS_2, FASTDDS_3

CLIENT = {'ROS_DISCOVERY_SERVER': '127.0.0.1:11811'}
PROFILE = """
<dds>
  <profiles>
    <participant profile_name="other"><rtps><builtin><discovery_config>
      <discoveryProtocol>SERVER</discoveryProtocol>
    </discovery_config></builtin></rtps></participant>
    <participant profile_name="mine" is_default_profile="true"><rtps>{}</rtps></participant>
  </profiles>
</dds>
"""
FINDS = """
<builtin><discovery_config><discoveryProtocol>{}</discoveryProtocol></discovery_config></builtin>
"""


@pytest.fixture(autouse=True)
def fast_dds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(discovery, 'is_fastdds', lambda: True)


def written(place: Path, rtps: str) -> str:
    file = place / 'profile.xml'
    file.write_text(PROFILE.format(rtps))
    return str(file)


def test_a_client_of_a_discovery_server_is_told_of_its_own_topics_only() -> None:
    said = partial_view(CLIENT) or ''
    assert 'only of topics on which it has a publisher or subscriber itself' in said
    assert said.endswith('(ROS_DISCOVERY_SERVER): set ROS_SUPER_CLIENT=TRUE to be told of all')
    assert why_nobody(CLIENT) == f'{said}; does the server run, is its address right?'


@pytest.mark.parametrize('spelled', ['TRUE', 'true', 'True', '1'])
def test_a_super_client_is_told_of_all_as_far_as_its_server_runs(spelled: str) -> None:
    environ = CLIENT | {'ROS_SUPER_CLIENT': spelled}
    assert partial_view(environ) is None
    assert 'does it run' in (why_nobody(environ) or '')


@pytest.mark.parametrize('spelled', ['', 'FALSE', '0', 'yes', 'on', 'tRUE', ' TRUE'])
def test_fast_dds_takes_no_other_word_for_a_super_client(spelled: str) -> None:
    assert partial_view(CLIENT | {'ROS_SUPER_CLIENT': spelled})


@pytest.mark.parametrize(
    'environ',
    [
        {},
        {'ROS_DISCOVERY_SERVER': ''},
        {'ROS_SUPER_CLIENT': 'FALSE'},
        CLIENT | {'ROS2_EASY_MODE': '127.0.0.1'},
        CLIENT | {'FASTDDS_ENVIRONMENT_FILE': 'env.json'},
    ],
    ids=str,
)
def test_without_a_server_or_where_it_is_not_certain_nothing_is_said(
    environ: dict[str, str],
) -> None:
    assert partial_view(environ) is None
    assert why_nobody(environ) is None


@pytest.mark.parametrize(
    'more', [{}, {'ROS_SUPER_CLIENT': 'TRUE'}, {'ROS_LOCALHOST_ONLY': '1'}], ids=str
)
def test_with_a_range_of_off_no_server_is_asked_whoever_names_it(
    tmp_path: Path, more: dict[str, str]
) -> None:
    off = more | {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'}
    profile = {FASTDDS_3.variable: written(tmp_path, FINDS.format('CLIENT'))}
    for environ in (off, CLIENT | off, profile | off):
        assert partial_view(environ) is None
        assert 'ROS_AUTOMATIC_DISCOVERY_RANGE is OFF' in (why_nobody(environ) or '')


def test_other_middlewares_look_at_none_of_these_variables(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(discovery, 'is_fastdds', lambda: False)
    assert partial_view(CLIENT) is None
    assert why_nobody(CLIENT | {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'}) is None


@pytest.mark.parametrize('servers', [';', ';;'])
def test_a_list_without_a_server_finds_nobody(servers: str) -> None:
    environ = {'ROS_DISCOVERY_SERVER': servers, 'ROS_SUPER_CLIENT': 'TRUE'}
    assert partial_view(environ) is None
    assert 'ROS_DISCOVERY_SERVER names no server' in (why_nobody(environ) or '')


@pytest.mark.parametrize('variable', [FASTDDS_2.variable, FASTDDS_3.variable])
def test_a_client_by_its_profile_is_one_whatever_the_environment_says(
    tmp_path: Path, variable: str
) -> None:
    file = written(tmp_path, FINDS.format('CLIENT'))
    said = partial_view(CLIENT | {'ROS_SUPER_CLIENT': 'TRUE', variable: file}) or ''
    assert f'write SUPER_CLIENT instead of CLIENT in {file}' in said
    assert 'ROS_SUPER_CLIENT' not in said, 'it counts for nothing'


@pytest.mark.parametrize('protocol', ['SUPER_CLIENT', 'SERVER', 'BACKUP', 'NONE'])
def test_another_protocol_in_a_profile_counts_before_the_environment(
    tmp_path: Path, protocol: str
) -> None:
    file = written(tmp_path, FINDS.format(protocol))
    assert partial_view(CLIENT | {FASTDDS_3.variable: file}) is None


@pytest.mark.parametrize('rtps', ['', FINDS.format('SIMPLE'), '<name>robot</name>'])
def test_a_profile_that_says_nothing_of_it_leaves_it_to_the_environment(
    tmp_path: Path, rtps: str
) -> None:
    file = written(tmp_path, rtps)
    assert partial_view({FASTDDS_3.variable: file}) is None
    assert 'ROS_SUPER_CLIENT' in (partial_view(CLIENT | {FASTDDS_3.variable: file}) or '')


def test_easy_mode_in_a_profile_is_a_super_client(tmp_path: Path) -> None:
    file = written(tmp_path, '<easy_mode_ip>127.0.0.1</easy_mode_ip>')
    assert partial_view(CLIENT | {FASTDDS_3.variable: file}) is None


def test_of_a_profile_that_cannot_be_read_nothing_is_said_here(tmp_path: Path) -> None:
    assert partial_view(CLIENT | {FASTDDS_3.variable: str(tmp_path / 'missing.xml')}) is None


@pytest.mark.parametrize(
    ('environ', 'said'),
    [
        ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}, 'nodes of other machines'),
        ({'ROS_LOCALHOST_ONLY': '1'}, 'nodes of other machines'),
        ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'}, 'no other node'),
    ],
)
def test_where_nobody_is_seen_a_short_reach_is_said(environ: dict[str, str], said: str) -> None:
    assert (why_nobody(environ) or '').startswith(said)
    assert partial_view(environ) is None


@pytest.mark.parametrize(
    'environ',
    [
        {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'},
        {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', 'ROS_STATIC_PEERS': 'robot7'},
        {'ROS_LOCALHOST_ONLY': '0'},
    ],
    ids=str,
)
def test_a_reach_beyond_this_machine_is_no_reason(environ: dict[str, str]) -> None:
    assert why_nobody(environ) is None


def test_a_route_that_waits_for_its_type_says_what_would_help(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr('os.environ', {})
    assert waits_for_type('/t').endswith('to learn its type from (from.type is not set)')
    monkeypatch.setattr('os.environ', CLIENT)
    said = waits_for_type('/t')
    assert said.endswith('set ROS_SUPER_CLIENT=TRUE to be told of all, or write from.type')
