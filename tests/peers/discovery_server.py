"""A discovery server of Fast DDS, on the loopback alone; prints `ready`.

discovery_server.py PORT
"""

import os
import sys
import tempfile
import time

import rclpy

PROFILE = """\
<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns="http://www.eprosima.com">
  <profiles>
    <transport_descriptors>
      <transport_descriptor>
        <transport_id>loopback</transport_id>
        <type>UDPv4</type>
        <interfaceWhiteList><address>127.0.0.1</address></interfaceWhiteList>
      </transport_descriptor>
    </transport_descriptors>
    <participant profile_name="server" is_default_profile="true">
      <rtps>
        <prefix>44.53.00.5f.45.50.52.4f.53.49.4d.41</prefix>
        <userTransports><transport_id>loopback</transport_id></userTransports>
        <useBuiltinTransports>false</useBuiltinTransports>
        <builtin>
          <discovery_config><discoveryProtocol>SERVER</discoveryProtocol></discovery_config>
          <metatrafficUnicastLocatorList>
            <locator><udpv4><address>127.0.0.1</address><port>{port}</port></udpv4></locator>
          </metatrafficUnicastLocatorList>
        </builtin>
      </rtps>
    </participant>
  </profiles>
</dds>
"""


def main() -> None:
    """Serve until it is ended."""
    with tempfile.NamedTemporaryFile('w', suffix='.xml') as file:
        file.write(PROFILE.format(port=sys.argv[1]))
        file.flush()
        os.environ['FASTDDS_DEFAULT_PROFILES_FILE'] = file.name
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'SYSTEM_DEFAULT'  # LOCALHOST has its own
        rclpy.init()
        node = rclpy.create_node('discovery_server', enable_rosout=False)  # it lives as long
        print('ready', flush=True)  # noqa: T201
        while node:
            time.sleep(1)


main()
