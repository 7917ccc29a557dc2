"""Commits that are waited for, within a limit."""

from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

from confluent_kafka import Consumer, KafkaError, KafkaException, TopicPartition

from ros2_kafka_bridge.threads import unattended

if TYPE_CHECKING:
    import threading


class Commits:
    """The commits of one client that are waited for.

    librdkafka waits without any limit for a broker that stands still (SIGSTOP: 75 s and more), so
    each has a thread of its own. The client must not be closed while one is at work.

    Args:
        client: A member of its group.
    """

    def __init__(self, client: Consumer) -> None:
        self._client = client
        self._late: list[threading.Thread] = []

    def within(self, seconds: float, offsets: Sequence[TopicPartition]) -> None:
        """Commit, and wait until the group has it.

        Raises:
            KafkaException: It was refused, or took too long: then it may still be done.
        """
        problems: list[KafkaException] = []

        def commit() -> None:
            try:
                self._client.commit(offsets=list(offsets), asynchronous=False)
            except KafkaException as error:
                problems.append(error)

        try:
            thread = unattended.start('commit', commit)
        except RuntimeError as error:
            raise _failure(KafkaError._CRIT_SYS_RESOURCE, str(error)) from error  # noqa: SLF001
        thread.join(seconds)
        if thread.is_alive():
            self._late.append(thread)
            text = f'the broker has not answered a commit within {seconds:g} s'
            raise _failure(KafkaError._TIMED_OUT, text)  # noqa: SLF001 (its public name)
        if problems:
            raise problems[0]

    def close_client(self) -> None:
        """Close the client, once none of its commits is at work any more."""
        for thread in self._late:
            thread.join()
        with suppress(KafkaException):  # fatal for the client, and known
            self._client.close()


def _failure(code: int, text: str) -> KafkaException:
    return KafkaException(KafkaError(code, text))
