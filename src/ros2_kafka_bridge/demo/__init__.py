"""`ros2-kafka-bridge demo`: random orders, Kafka -> ROS -> Kafka, counted while they move.

Read in this order: `run` is the whole demo, `trip` the way of the orders through the bridge,
`ends` what that joins, `tally` what is counted, `table` what a person sees of it. It is a client
of its own, and starts the process that `run` becomes. In the bridge its command alone uses it.
"""
