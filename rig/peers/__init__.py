"""The other ends of a bridge: users' nodes and clients, each a program to be run by `python -m`.

- `publisher`, `subscriber`: a node of ROS with one topic.
- `ros_node`: a node of ROS with many topics, of types that it may describe.
- `cyclone`: a node of the second DDS vendor.
- `kafka_producer`: a client of Kafka.
- `ends`, `pace`: what those of ROS have in common, and when a message is due.
"""
