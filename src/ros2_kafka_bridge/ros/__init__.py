"""Everything that touches ROS 2. No other room imports rclpy, but the paper's nodes in `demo`."""
