"""The configuration: settings classes, the file they are read from, and what its mistakes say.

It opens nothing but that file: no Kafka, no ROS.
"""
