"""`python -m warehouse.benchmark`: the command `warehouse benchmark` alone."""

import typer

from warehouse.benchmark.cli import benchmark

typer.run(benchmark)
