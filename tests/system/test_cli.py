"""The command line over longer times: status lines, a DDS profile of the user's own."""

import json
import re
from functools import partial

from harness import Bench, Process, eventually, lines, to_kafka, values


def logged(bridge: Process) -> list[str]:
    """The lines of the bridge itself."""
    # DDS writes to the same place, in its own way: shared memory that a killed process has left.
    return [line for line in lines(bridge.log) if '[RTPS_TRANSPORT_SHM Error]' not in line]


def test_a_status_line_of_each_route_comes_every_ten_seconds(
    bench: Bench, topic_name: str
) -> None:
    file = bench.config([to_kafka('/orders', topic_name)])
    with (
        bench.run(file, '--log-format', 'json') as bridge,
        bench.publisher('/orders', '--count', '10'),
    ):
        bridge.wait_for('running: 10 confirmed, ', timeout_s=40)
        assert bridge.end() == 0
    *_, status = [line for line in map(json.loads, logged(bridge)) if '/s, ' in line['message']]
    assert (status['level'], status['route']) == ('info', 'to_kafka')
    written = r'running: 10 confirmed, [01]/s, 0 in flight, 0 dead-lettered'
    assert re.fullmatch(written, status['message'])
    assert (status['state'], status['confirmed'], status['in_flight']) == ('running', 10, 0)


PROFILE = """<?xml version="1.0" encoding="UTF-8"?>
<profiles xmlns="http://www.eprosima.com">
  <participant profile_name="robot" is_default_profile="true">
    <rtps>
      <name>robot 7</name>
      <builtin>
        <discovery_config>
          <leaseDuration><sec>2</sec></leaseDuration>
          <leaseAnnouncement><sec>0</sec><nanosec>500000000</nanosec></leaseAnnouncement>
        </discovery_config>
      </builtin>
    </rtps>
  </participant>
  <data_reader profile_name="/orders">
    <historyMemoryPolicy>DYNAMIC</historyMemoryPolicy>
  </data_reader>
</profiles>
"""


def test_the_users_own_dds_profile_counts(bench: Bench, topic_name: str) -> None:
    profile = bench.place / 'profile.xml'
    environ = {'FASTDDS_DEFAULT_PROFILES_FILE': str(profile)}
    file = bench.config([to_kafka('/orders', topic_name)])
    # A bridge that stands still for longer than its lease is given up: then messages are lost.
    profile.write_text(PROFILE.replace('<sec>2</sec>', '<sec>20</sec>'))
    with (
        bench.run(file, **environ) as patient,
        bench.publisher('/orders', '--count', '3000') as publisher,
    ):
        publisher.wait_for('published')
        received = values(bench.records(topic_name, 3000))
        assert received == [b'%d' % number for number in range(3000)]
        assert patient.end() == 0
    profile.write_text(PROFILE)
    with (
        bench.run(file, **environ) as bridge,
        # At the kill more of it is left than the history holds.
        bench.publisher('/orders', '--count', '20000', '--rate', '3000') as publisher,
    ):
        eventually(partial(bench.reaches, topic_name, 4000), 60, bridge.output)
        bridge.kill()
        # Their lease, not the default of 20 s, says when the reader is given up.
        publisher.wait_for('published', timeout_s=12)
    for process in (patient, bridge):
        assert 'does not bound' not in process.output()
        assert 'XMLPARSER' not in process.output()
