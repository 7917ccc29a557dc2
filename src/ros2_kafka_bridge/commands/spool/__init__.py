"""`spool`: what waits on disk for Kafka."""
