"""Everything that touches Kafka; no other room moves records with confluent_kafka.

It is given properties, topics and names, and knows neither a route nor the configuration.
(`formats` and `check` use its Schema Registry client; `testing` and `demo` are clients of their
own.)
"""
