"""QoS of the bridge's endpoints, from the settings of a route."""

from typing import Any, NamedTuple

from ros2_kafka_bridge.config.settings import QoS

_NO_DEADLINE_NS = 2**31 * 10**9 - 1


def profile(qos: QoS, reliability: str = 'reliable', durability: str = 'volatile') -> Any:
    """Make rclpy's QoS profile: what the route says, else KEEP_ALL and the given two."""
    from rclpy.duration import Duration  # noqa: PLC0415 (heavy)
    from rclpy.qos import (  # noqa: PLC0415
        DurabilityPolicy,
        HistoryPolicy,
        LivelinessPolicy,
        QoSProfile,
        ReliabilityPolicy,
    )

    chosen: dict[str, Any] = {
        'reliability': ReliabilityPolicy[(qos.reliability or reliability).upper()],
        'durability': DurabilityPolicy[(qos.durability or durability).upper()],
        'history': HistoryPolicy[(qos.history or 'keep_all').upper()],
        'depth': qos.depth or 0,
    }
    if qos.liveliness is not None:
        chosen['liveliness'] = LivelinessPolicy[qos.liveliness.upper()]
    if qos.deadline_s is not None:
        chosen['deadline'] = Duration(nanoseconds=int(qos.deadline_s * 1e9))
    if qos.lifespan_s is not None:
        chosen['lifespan'] = Duration(nanoseconds=int(qos.lifespan_s * 1e9))
    return QoSProfile(**chosen)


def waits(qos: QoS) -> bool:
    """Whether a writer of this QoS waits for its readers instead of overwriting."""
    return qos.reliability != 'best_effort' and qos.history != 'keep_last'


class Unmatched(NamedTuple):
    """One thing in which a publisher and a subscription differ too much.

    Args:
        reason: What.
        setting: The setting of a route that publishes in which they would agree.
        value: What it would have to be.
    """

    reason: str
    setting: str
    value: str


def mismatch(publisher: Any, subscription: Any) -> str:
    """Why a publisher and a subscription of these QoS do not match; empty if they do."""
    return '; '.join(it.reason for it in unmatched(publisher, subscription))


def unmatched(publisher: Any, subscription: Any) -> list[Unmatched]:
    """All in which a publisher and a subscription of these QoS do not match."""
    from rclpy.qos import (  # noqa: PLC0415 (heavy)
        DurabilityPolicy,
        LivelinessPolicy,
        ReliabilityPolicy,
    )

    found = []
    if (
        publisher.reliability == ReliabilityPolicy.BEST_EFFORT
        and subscription.reliability == ReliabilityPolicy.RELIABLE
    ):
        text = 'reliability: best_effort is offered, reliable is asked for'
        found.append(Unmatched(text, 'reliability', 'reliable'))
    if (
        publisher.durability == DurabilityPolicy.VOLATILE
        and subscription.durability == DurabilityPolicy.TRANSIENT_LOCAL
    ):
        text = 'durability: volatile is offered, transient_local is asked for'
        found.append(Unmatched(text, 'durability', 'transient_local'))
    # A zero and an enormous deadline are both none: DDS and rclpy write it differently.
    asked_ns = subscription.deadline.nanoseconds
    if 0 < asked_ns < _NO_DEADLINE_NS:
        offered_ns = publisher.deadline.nanoseconds
        if offered_ns == 0 or offered_ns > asked_ns:
            value = f'{asked_ns / 1e9:g}'
            text = f'deadline: {value} s is asked for, longer is offered'
            found.append(Unmatched(text, 'deadline_s', value))
    if (
        publisher.liveliness == LivelinessPolicy.AUTOMATIC
        and subscription.liveliness == LivelinessPolicy.MANUAL_BY_TOPIC
    ):
        text = 'liveliness: automatic is offered, manual_by_topic is asked for'
        found.append(Unmatched(text, 'liveliness', 'manual_by_topic'))
    return found
