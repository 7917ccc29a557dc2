"""What is said to people: lines of the log, repeated ones summed, and text that is safe to show.

Knows nothing of routes, Kafka or ROS but the words it is given.
"""
