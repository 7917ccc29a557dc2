"""Everything that touches Kafka. No other package imports confluent_kafka."""
