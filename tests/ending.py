"""Processes that end with their test, however that ends."""

from collections.abc import Iterator
from contextlib import contextmanager
from subprocess import Popen
from typing import AnyStr

from patience import patient

from rig.processes import KILLED_S


@contextmanager
def ended(process: Popen[AnyStr]) -> Iterator[Popen[AnyStr]]:
    """Kill a process at the end of `with`, and close its pipes."""
    try:
        yield process
    finally:
        process.kill()
        process.wait(patient(KILLED_S))
        for pipe in (process.stdin, process.stdout, process.stderr):
            if pipe is not None:
                pipe.close()
