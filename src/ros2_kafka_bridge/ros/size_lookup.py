"""What the graph tells of the size of messages, looked up by a process of its own.

    python -m ros2_kafka_bridge.ros.size_lookup FD

It reads a question from its standard input, and writes a line for each answer to the descriptor.
"""

import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import BinaryIO, Final

import msgspec

from ros2_kafka_bridge.errors import BridgeError
from ros2_kafka_bridge.logs.lines import Log
from ros2_kafka_bridge.logs.text import printable
from ros2_kafka_bridge.message_types.description import DescribedTypes, make_layout
from ros2_kafka_bridge.message_types.layout import Layout
from ros2_kafka_bridge.message_types.size import largest_message_bytes
from ros2_kafka_bridge.message_types.source import TypeSource
from ros2_kafka_bridge.outside.parent import end_with_parent
from ros2_kafka_bridge.ros.discovery import ANNOUNCED_S
from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.helper_process import helper_process
from ros2_kafka_bridge.ros.node import RosNode, open_node
from ros2_kafka_bridge.ros.type_request import ask_users
from ros2_kafka_bridge.ros.used_type import UsedType, definitions, users
from ros2_kafka_bridge.threads.stop import Stop

_ANSWER_S: Final = 2.5
_ALL_S: Final = 15.0
_LOOK_S: Final = 0.05
_AT_ONCE: Final = 8  # the service of a node holds ten requests, and drops the rest
_LONGEST: Final = 300


class SizedEnd(msgspec.Struct):
    """The end of a route in ROS.

    Args:
        topic: The ROS topic.
        type_name: The type that the file names, if it does.
        max_message_bytes: Of the route.
    """

    topic: str
    type_name: str | None
    max_message_bytes: int


class SizeQuestion(msgspec.Struct):
    """What is looked up, and as whom.

    Args:
        bridge: Its name.
        domain_id: As of the file.
        lease_s: As of the file.
        folders: Of .msg files.
        ends: Of routes.
    """

    bridge: str
    domain_id: int | None
    lease_s: float | None
    folders: list[str]
    ends: list[SizedEnd]


class SizeAnswer(msgspec.Struct):
    """How large messages of an end may be, by its place in the question."""

    number: int
    size_bytes: int | None


def ask(
    question: SizeQuestion, environ: Mapping[str, str], stop: Stop, log: Log
) -> list[SizeAnswer]:
    """Let a process look; what it has not told after 15 s is not known.

    Args:
        question: What is looked up.
        environ: Of the process.
        stop: Ends the look.
        log: Where to say why nothing is known.
    """
    try:
        with _in_memory('question') as asked, _in_memory('answers') as answers:
            asked.write(msgspec.json.encode(question))
            asked.seek(0)
            with _in_memory('said') as said:
                status = _run(asked, answers, said, environ, stop)
                if status not in {0, -signal.SIGKILL}:
                    log.warning('cannot look who is there: %s', _last_line(said) or status)
            answers.seek(0)
            return [msgspec.json.decode(line, type=SizeAnswer) for line in answers]
    except (OSError, ValueError, TypeError, msgspec.DecodeError) as error:
        log.warning('cannot look who is there: %s', error)
        return []


def _run(
    asked: BinaryIO, answers: BinaryIO, said: BinaryIO, environ: Mapping[str, str], stop: Stop
) -> int | None:
    """Run the process to its end, or for as long as it may take; returns its exit status."""
    options = [str(answers.fileno())]
    with helper_process(
        __name__, options, env=environ, stdin=asked, stdout=said, stderr=said,
        pass_fds=[answers.fileno()],
    ) as process:  # fmt: skip
        until_s = time.monotonic() + _ALL_S
        while process.poll() is None and time.monotonic() < until_s and not stop.asked:
            time.sleep(_LOOK_S)
    return process.returncode


def _in_memory(name: str) -> BinaryIO:
    return os.fdopen(os.memfd_create(name), 'w+b')  # no folder may be writable


def _last_line(said: BinaryIO) -> str:
    said.seek(0)
    lines = said.read().decode(errors='replace').splitlines()
    return printable(lines[-1])[:_LONGEST] if lines else ''


# The process that looks


def main(descriptor: int) -> None:
    """Read a question, and write a line for each answer to a file."""
    end_with_parent()

    def tell(answer: SizeAnswer) -> None:
        os.write(descriptor, msgspec.json.encode(answer) + b'\n')

    _look(msgspec.json.decode(sys.stdin.buffer.read(), type=SizeQuestion), tell)


def _look(question: SizeQuestion, tell: Callable[[SizeAnswer], None]) -> None:
    """Tell of each end that is found how large its messages may be."""
    source = TypeSource([Path(folder) for folder in question.folders])
    histories = Histories({}, {}, question.lease_s)
    with open_node(f'{question.bridge}_look', question.domain_id, histories) as node:

        def load(seen: tuple[int, SizedEnd, UsedType]) -> None:
            number, end, used = seen
            with suppress(BridgeError):  # its route tells it
                layout = _layout(node, source, end.topic, used)
                tell(SizeAnswer(number, largest_message_bytes(layout, end.max_message_bytes)))

        with ThreadPoolExecutor(_AT_ONCE) as pool:
            for _ in pool.map(load, _seen(node, question.ends)):
                pass


def _seen(node: RosNode, ends: Sequence[SizedEnd]) -> Iterator[tuple[int, SizedEnd, UsedType]]:
    """Those of which somebody shows the type, as they are seen."""
    waiting = dict(enumerate(ends))
    until_s = time.monotonic() + ANNOUNCED_S
    while waiting and time.monotonic() < until_s:
        for number, end in [*waiting.items()]:
            with suppress(BridgeError):  # a name that nobody can read
                if (used := _used_type(node, end)) is not None:
                    yield number, waiting.pop(number), used
        time.sleep(_LOOK_S)


def _used_type(node: RosNode, end: SizedEnd) -> UsedType | None:
    """The type that is published, or how the one that the file names is defined; None yet."""
    name = end.type_name
    peers = node.publishers(end.topic) if name is None else users(node, end.topic, name)
    types = {peer.message_type for peer in peers}
    return UsedType(types.pop(), definitions(peers)) if len(types) == 1 else None


def _layout(node: RosNode, source: TypeSource, topic: str, used: UsedType) -> Layout:
    """What a type looks like, as those describe it who use it on a topic."""
    look = partial(users, node, topic, used.name)

    def ask_them(name: str, wanted_hash: str) -> DescribedTypes:
        return ask_users(node, look, name, wanted_hash, _ANSWER_S)

    return make_layout(used.name, source.describe(used.name, used.definitions, ask_them))


if __name__ == '__main__':
    main(int(sys.argv[1]))
