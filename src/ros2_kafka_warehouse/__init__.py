"""The warehouse: orders in Kafka, robots in ROS 2, and the bridge between them.

The reference application of `ros2_kafka_bridge`, which it uses as any user would: by a
configuration file. The domain (`ros2_kafka_warehouse.domain`) knows no ROS, no Kafka and no clock;
`ros2_kafka_warehouse.nodes` puts each of its modules into a ROS 2 node;
`ros2_kafka_warehouse.page` shows it live.
"""
