"""Everything that touches ROS 2. No other package imports rclpy."""
