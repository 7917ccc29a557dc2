"""What the bridge is tested with, shipped so that its users test the same way.

- `local_kafka.LocalKafka`: one real Apache Kafka node (needs Java 17 or newer, and Maven once).
- `memory`: the four ends of a pipeline in memory, to see what it does with them.
- `embedded_broker.EmbeddedBroker`: librdkafka's mock cluster, inside this process, at once.
- `orders`: the random warehouse orders of the demo and of the benchmarks.

Import the module that you need: this package itself imports nothing. Of the bridge only the demo
uses it; what is for the bridge's own tests alone is in `rig`, and not shipped.
"""
