"""A replay that the page has asked for, in a process of its own.

Standard input gives the order as one line of JSON, and stays open: at its end, whoever has
started the replay is gone, and the replay ends, too.

It does what `ros2-kafka-bridge dead-letters replay` does, with the configuration that runs
instead of a file, and with letters that are named one by one.
"""

import os
import signal
import sys
import threading
import time
from typing import Annotated, Any, Final

import msgspec

from ros2_kafka_bridge.errors import BridgeError

_ENDING_S: Final = 5.0


class ReplayForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is to be replayed, and how, as the page asks for it.

    Args:
        topic: The dead-letter topic.
        dry_run: As `--dry-run`.
        places: The letters, as `topic[0]@5`; None for all of the topic.
        to_ros: As `--to ros`.
        again: As `--again`.
        force: As `--force`.
    """

    topic: str
    dry_run: bool
    places: Annotated[tuple[str, ...], msgspec.Meta(min_length=1, max_length=5000)] | None = None
    to_ros: bool = False
    again: bool = False
    force: bool = False


class ReplayOrder(msgspec.Struct, frozen=True):
    """What the process is told.

    Args:
        values: The configuration, as `config.settings.restored` takes it.
        form: What it is to do.
    """

    values: dict[str, Any]
    form: ReplayForm


def _end_with_starter() -> None:
    """Wait for the end of standard input, then end as `ReplayRunner.close` would have it.

    The death signal of Linux would not do: it comes when the thread dies that has started this.
    """
    # Not through sys.stdin: its lock, held here, would break the end of the interpreter.
    while os.read(0, 1024):
        pass
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(_ENDING_S)
    os._exit(1)  # Kafka does not answer; its transactions leave nothing half done


def main() -> int:
    """Do what standard input says; returns the exit status of the command."""
    # The bridge holds these back; here they end the replay after the batch in hand.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    order = msgspec.json.decode(sys.stdin.buffer.readline(), type=ReplayOrder)
    threading.Thread(target=_end_with_starter, name='starter', daemon=True).start()

    from ros2_kafka_bridge.commands.dead_letters import replay  # noqa: PLC0415 (heavy: the order is read first)
    from ros2_kafka_bridge.commands.dead_letters.report import LetterQuery, spoken  # noqa: PLC0415
    from ros2_kafka_bridge.config.settings import restored  # noqa: PLC0415
    from ros2_kafka_bridge.dead_letters.filter import LetterFilter  # noqa: PLC0415
    from ros2_kafka_bridge.dead_letters.letter import LetterPlace  # noqa: PLC0415

    form, places = order.form, None
    if form.places is not None:
        places = frozenset(found for text in form.places if (found := LetterPlace.parse(text)))
    options = replay.ReplayOptions(
        to_ros=form.to_ros,
        dry_run=form.dry_run,
        again=form.again,
        force=form.force,
        all=form.places is None,
    )
    try:
        query = LetterQuery(restored(order.values), form.topic, LetterFilter(places=places))
        return spoken(lambda: replay.replay(query, options))
    except BridgeError as error:
        print(error, file=sys.stderr)  # noqa: T201 (the words for the user)
        return 2


if __name__ == '__main__':
    sys.exit(main())
