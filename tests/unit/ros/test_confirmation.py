"""Whether acknowledgements are believed, by what the probe has found.

`tests/integration/test_confirmation.py` has a middleware that lies, and `tests/system` readers
that are stopped.
"""

import threading
import time
from typing import Any
from unittest.mock import MagicMock

import pytest

from ros2_kafka_bridge.config.settings import Config, KafkaToRosRoute
from ros2_kafka_bridge.config.validation import validated
from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.ros import confirmation
from ros2_kafka_bridge.ros.confirmation import Confirmation, asks_readers
from ros2_kafka_bridge.ros.probe import Abilities, denies
from ros2_kafka_bridge.threads.stop import Stop

DENIES_NOTHING = 'rmw_liar does not tell what has arrived: it denied nothing of a message'


class Trials:
    """Readers that are stopped, and how each trial ends."""

    def __init__(self) -> None:
        self.ends: list[Any] = []
        self.takes_s = 0.0

    def __call__(self, *_: Any) -> bool | None:
        end = self.ends.pop(0)
        time.sleep(self.takes_s)
        if isinstance(end, Exception):
            raise end
        assert end is None or isinstance(end, bool)
        return end


@pytest.fixture(autouse=True)
def trials(monkeypatch: pytest.MonkeyPatch) -> Trials:
    """None, unless a test names some: whoever tries one then fails."""
    made = Trials()
    monkeypatch.setattr(confirmation, 'middleware', lambda: 'rmw_liar')
    monkeypatch.setattr(confirmation, 'denies_arrival', made)
    return made


def found(*, denied: bool) -> Confirmation:
    abilities = Abilities(bounded=denied, gid=True, seq=True, own=b'', denies=denied)
    return Confirmation(MagicMock(), abilities)


def test_who_has_denied_a_full_history_needs_no_trial() -> None:
    assert found(denied=True).require(Stop())


def test_guarantee_6c_who_denies_nothing_ends_the_route_and_the_cures_are_named(
    trials: Trials,
) -> None:
    trials.ends = [False]
    lies = found(denied=False)
    for _ in range(2):
        with pytest.raises(RouteError) as told:
            lies.require(Stop())
        assert str(told.value).startswith(DENIES_NOTHING)
        assert 'rmw_fastrtps_cpp' in str(told.value)
        assert 'ros: {confirmation: none}' in str(told.value)


def test_who_denies_what_a_stopped_reader_has_not_got_is_believed_from_then_on(
    trials: Trials,
) -> None:
    trials.ends = [True]
    tried = found(denied=False)
    assert tried.require(Stop())
    assert tried.require(Stop())


def test_what_a_trial_could_not_show_is_tried_again(trials: Trials) -> None:
    trials.ends = [RouteError('it was not discovered'), True]
    tried = found(denied=False)
    with pytest.raises(RouteError, match='it was not discovered'):
        tried.require(Stop())
    assert tried.require(Stop())


def test_a_stop_ends_the_waiting_and_nothing_is_known_by_it(trials: Trials) -> None:
    stop = Stop()
    stop.ask()
    tried = found(denied=False)
    assert not tried.require(stop)
    trials.ends = [True]
    assert tried.require(Stop())


def test_all_routes_share_one_trial_but_for_one_that_was_stopped(trials: Trials) -> None:
    """That of the route whose stop came first is left, and another route tries it itself."""
    trials.ends, trials.takes_s = [None, True], 0.2
    tried, answers = found(denied=False), []
    stops = [Stop() for _ in range(4)]
    waiting = [
        threading.Thread(target=lambda stop=stop: answers.append(tried.require(stop)))
        for stop in stops
    ]
    waiting[0].start()
    time.sleep(0.05)
    for thread in waiting[1:]:
        thread.start()
    stops[0].ask()
    for thread in waiting:
        thread.join()
    assert sorted(answers) == [False, True, True, True]
    assert trials.ends == []


@pytest.mark.parametrize(
    ('ros', 'qos', 'asked'),
    [
        ({}, {}, True),
        ({'confirmation': 'none'}, {}, False),
        ({}, {'reliability': 'best_effort'}, False),
        ({}, {'history': 'keep_last', 'depth': 1}, False),
    ],
)
def test_guarantee_6c_a_writer_that_overwrites_asks_nobody(
    *, ros: dict[str, Any], qos: dict[str, Any], asked: bool
) -> None:
    sink = {'ros': '/orders', 'type': 'std_msgs/msg/String', 'qos': qos}
    kafka = {'bootstrap.servers': 'localhost:9092'}
    routes = [{'name': 'r', 'from': {'kafka': 'orders'}, 'to': sink, 'format': 'text'}]
    config = validated(Config, {'name': 'me', 'kafka': kafka, 'ros': ros, 'routes': routes})
    [route] = config.routes
    assert isinstance(route, KafkaToRosRoute)
    assert asks_readers(route, config) is asked


def test_a_middleware_that_cannot_be_asked_denies_nothing() -> None:
    from rclpy.impl.implementation_singleton import rclpy_implementation  # noqa: PLC0415 (heavy)

    publisher = MagicMock()
    publisher.wait_for_all_acked.side_effect = rclpy_implementation.RCLError('unsupported')
    assert not denies(publisher)
    publisher.wait_for_all_acked.side_effect = [True, False]
    assert [denies(publisher), denies(publisher)] == [False, True]
