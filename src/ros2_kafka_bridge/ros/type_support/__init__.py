"""Endpoints of any type, made of its name, hash and description: no package is imported.

What rclpy takes from a message class is one pointer, and of what stands behind it raw bytes need
a name, a hash and a description. `structures` has the structures; `handle` fills them, those of a
description by `descriptions`. `choice` tells whether they are those of the ROS here: `comparison`
reads what is `loaded`, and `self_test` publishes a message. Where they are not, the class is that
of the package: `imported`.
"""
