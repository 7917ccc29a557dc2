"""`python -m ros2_kafka_warehouse.benchmark`: `ros2-kafka-warehouse benchmark` alone."""

import typer

from ros2_kafka_warehouse.benchmark.cli import benchmark

typer.run(benchmark)
