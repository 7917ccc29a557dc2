"""The node by which ROS controls a bridge: diagnostics, lifecycle, services, parameters.

It carries no message and asks no route: it tells what was reported, and hands on what is asked.
"""
