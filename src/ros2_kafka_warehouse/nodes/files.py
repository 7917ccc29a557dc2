"""Profiles: files that an operator edits, and that a module says to all others."""

from collections.abc import Callable
from pathlib import Path
from typing import Final

from ros2_kafka_warehouse.domain.profile_files import ProfileError
from ros2_kafka_warehouse.messages.message import Message
from ros2_kafka_warehouse.nodes.node import Module

_LOOK_S: Final = 2.0


def say_file(module: Module, topic: str, path: Path, read: Callable[[Path], Message]) -> None:
    """Say what a file holds, and say it again when it has changed.

    A file that has become wrong changes nothing: the log says every mistake in it.

    Raises:
        ProfileError: The file is wrong from the start.
    """
    speaker = module.speaker(topic)
    speaker.say(read(path))
    said = _changed(path)

    def look() -> None:
        nonlocal said
        now = _changed(path)
        if now == said:
            return
        said = now
        try:
            speaker.say(read(path))
            module.log.info('%s has changed', path)
        except ProfileError as error:
            module.log.error('%s has changed, and is not used:\n%s', path, error)  # noqa: TRY400 (a user's mistake)

    module.log.info('works')
    module.each_s(_LOOK_S, look)


def _changed(path: Path) -> tuple[int, int]:
    try:
        found = path.stat()
    except OSError:
        return 0, 0
    return found.st_mtime_ns, found.st_size
