"""Everything that touches Kafka; no other room moves records with confluent_kafka.

(`formats` asks its Schema Registry client, `testing` and `demo` are clients of their own.)
Nothing here knows a route or its configuration.
"""
