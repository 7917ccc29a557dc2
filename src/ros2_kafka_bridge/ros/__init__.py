"""Everything that touches ROS 2: the ends of routes, and the node of a process in the graph.

No other room imports rclpy; nothing here imports `kafka`.
"""
