"""A subscriber of any message type, and what it has got."""

from contextlib import ExitStack

from harness import Bench, Process, eventually, lines
from messages import exact_of


def reader_of(bench: Bench, message_type: str, topic: str = '/out') -> Process:
    """A subscriber of one topic, ready; what it reads comes into the file `received`."""
    file = str(bench.place / 'received')
    with ExitStack() as stack:
        words = topic, file, '--type', message_type, '--form', 'hex'
        reader = stack.enter_context(bench.peer('subscriber', *words))
        reader.wait_for('ready')
        stack.pop_all()
    return reader


def received(bench: Bench, count: int, bridge: Process, message_type: str) -> list[bytes]:
    """What the reader has got, once that are so many messages."""
    file = bench.place / 'received'
    eventually(lambda: len(lines(file)) >= count, 60, bridge.output)
    return [exact_of(message_type)(bytes.fromhex(line)) for line in lines(file)]
