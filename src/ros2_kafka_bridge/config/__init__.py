"""The configuration: settings classes, the file they are read from, and what its mistakes say.

It reads that file and those that it names with `${file:...}`, and makes no client of Kafka or ROS.
"""
