"""Whether the acknowledgements of a middleware can be believed: Kafka's offsets follow them.

No API tells. One that has said of a full history that not all is acknowledged can be: the probe
asks. Another one is tried with a reader that is stopped, and cannot acknowledge (`trial.py`).
"""

import threading
from concurrent.futures import Future, wait
from typing import Final

from ros2_kafka_bridge.config.settings import Config, KafkaToRosRoute
from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.ros.node import RosNode, middleware
from ros2_kafka_bridge.ros.probe import Abilities
from ros2_kafka_bridge.ros.qos import waits
from ros2_kafka_bridge.ros.trial import denies_arrival
from ros2_kafka_bridge.threads.stop import Stop

_STEP_S: Final = 0.05


def asks_readers(route: KafkaToRosRoute, config: Config) -> bool:
    """Whether the offsets of a route follow what its readers acknowledge."""
    return config.ros.confirmation == 'acknowledged' and waits(route.qos)


class Confirmation:
    """Whether this middleware tells what has arrived, found out once somebody has to know.

    Args:
        node: The bridge's node.
        abilities: What the probe has found.
    """

    def __init__(self, node: RosNode, abilities: Abilities) -> None:
        self._node = node
        self._tells = True if abilities.denies else None
        self._lock = threading.Lock()
        self._trial: Future[None] | None = None

    def require(self, stop: Stop) -> bool:
        """Let nothing be committed by acknowledgements that prove nothing.

        Args:
            stop: Ends the waiting for a trial.

        Returns:
            False where a stop came before it was known.

        Raises:
            RouteError: The middleware does not tell what has arrived; or that could not be tried,
                and the next call tries again.
        """
        while self._tells is None:
            if stop.asked:
                return False
            trial = self._tried(stop)
            while not trial.done():
                if stop.asked:
                    return False
                wait([trial], _STEP_S)
            trial.result()
        if not self._tells:
            raise RouteError(
                f'{middleware()} does not tell what has arrived: it denied nothing of a message '
                'whose reader was stopped. Offsets would be committed of messages that are lost '
                '(guarantee 1). Run the bridge on rmw_fastrtps_cpp, if its nodes are on DDS, or '
                'let offsets follow the publication: ros: {confirmation: none}'
            )
        return True

    def _tried(self, stop: Stop) -> 'Future[None]':
        """Try it, or join a trial that is on: all routes that wait for one share its end."""
        with self._lock:
            if self._trial is not None:
                return self._trial
            trial = self._trial = Future()
        try:
            self._tells = denies_arrival(self._node, stop)
            trial.set_result(None)
        except BaseException as error:  # noqa: BLE001 (raised by whoever waits)
            trial.set_exception(error)
        finally:
            with self._lock:
                self._trial = None
        return trial
