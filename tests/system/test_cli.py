"""The command line over longer times: status lines, a DDS profile of the user's own."""

import json
import re
from collections.abc import Callable
from contextlib import ExitStack

from support.bridges.numbers_to_kafka import published
from support.bridges.routes import lines, to_kafka, values
from support.processes.harness import Bench, Process
from support.processes.lifetimes import Leave


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
          <leaseDuration><sec>{lease_s}</sec></leaseDuration>
          <leaseAnnouncement><sec>0</sec><nanosec>500000000</nanosec></leaseAnnouncement>
        </discovery_config>
      </builtin>
    </rtps>
  </participant>
  <data_reader profile_name="/{topic}">
    <historyMemoryPolicy>DYNAMIC</historyMemoryPolicy>
  </data_reader>
</profiles>
"""


def test_the_users_own_dds_profile_counts(
    bench: Bench, topic_name: str, unique: Callable[[str], str]
) -> None:
    """Who waits for a dead reader waits as long as the lease that its profile says."""
    short, long = bench.place / 'short', bench.place / 'long'
    topics = {short: topic_name, long: unique('topic')}
    for place, lease_s in ((short, 2), (long, 600)):
        place.mkdir()
        (place / 'profile.xml').write_text(PROFILE.format(topic=place.name, lease_s=lease_s))
    with ExitStack() as stack:
        bridges, publishers, leaves = {}, {}, {}
        for place, topic in topics.items():
            file = bench.config([to_kafka(f'/{place.name}', topic)], name=unique('bridge'))
            profile = {'FASTDDS_DEFAULT_PROFILES_FILE': str(place / 'profile.xml')}
            bridges[place] = stack.enter_context(bench.run(file, **profile))
            leave = leaves[place] = Leave(place)
            publisher = bench.publisher(f'/{place.name}', '--count', '20000', *leave.options)
            publishers[place] = stack.enter_context(publisher)
            leave.up_to(3000)
            assert values(bench.records(topic, 3000)) == [b'%d' % n for n in range(3000)]
        # The long one first: were both leases the same, it would be forgotten first.
        for place in (long, short):
            bridges[place].kill()
            leaves[place].up_to(20_000)
            # From 8000 on, or earlier: what its reader had not acknowledged when it died.
            publishers[place].wait_for('held back from ')
        publishers[short].wait_for('published')
        assert not published(publishers[long])
    for bridge in bridges.values():
        assert 'does not bound' not in bridge.output()
        assert 'XMLPARSER' not in bridge.output()
