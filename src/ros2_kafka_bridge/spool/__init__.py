"""The way over the disk, for messages that Kafka cannot take just now.

`spooling` leads there and back, `backlog` knows what waits, `store` is the queue in its file, and
`repair` makes a damaged one whole again. It knows no client of Kafka and no ROS: its pipeline
tells it when Kafka is away, and what is there already.
"""
