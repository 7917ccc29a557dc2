"""All that a route has taken and that has not ended; one owner of it, and of its state.

`stage` says where an entry can be, and which steps it may make; `flight` makes them. Nobody else
does. `records` and `messages` say what an entry is, to ROS and to Kafka.
"""
