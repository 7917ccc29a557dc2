"""The way over the disk, for messages that Kafka cannot take just now.

`spooling` leads there and back, `backlog` knows what waits, `store` is the queue, `file` its file,
which `salvage` repairs. It knows no client of Kafka and no ROS: its pipeline tells it when Kafka
is away, and what is there already.
"""
