"""`python -m ros2_kafka_bridge`."""

from ros2_kafka_bridge.cli import main

main()
