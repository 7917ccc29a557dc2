"""The bridge as a managed node: rclpy's state machine, moved by what the bridge itself does.

Imports rclpy: import it where ROS is needed for sure.
"""

import threading
from collections.abc import Callable, Sequence
from typing import Any, Final

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.lifecycle.node import LifecycleNodeMixin
from rclpy.node import Node

from ros2_kafka_bridge.errors import BridgeError
from ros2_kafka_bridge.logs.lines import Log
from ros2_kafka_bridge.protocol.monitor import Answer, Do, Lifecycle
from ros2_kafka_bridge.ros.errors import translated

_U, _I, _A = Lifecycle.UNCONFIGURED, Lifecycle.INACTIVE, Lifecycle.ACTIVE

_WAYS: Final = {
    (_U, _I): ('configure',),
    (_U, _A): ('configure', 'activate'),
    (_I, _U): ('cleanup',),
    (_I, _A): ('activate',),
    (_A, _I): ('deactivate',),
    (_A, _U): ('deactivate', 'cleanup'),
}
"""The transitions that lead from one state to another."""

_TRANSITIONS: Final = frozenset({'configure', 'cleanup', 'activate', 'deactivate', 'shutdown'})


class ManagedNode(LifecycleNodeMixin, Node):
    """A managed node whose transitions are those of the bridge.

    rclpy's own `LifecycleNode` lets a long transition hold up every other service, and, in Jazzy,
    gives no answer at all to a transition that is not possible.

    Args:
        name: Of the node.
        ask: Asks the bridge for a transition, and waits until it has ended.
        log: Says what was asked for, and why it was refused.
        more: For `rclpy.node.Node`.
    """

    def __init__(self, name: str, ask: Callable[[Do], Answer], log: Log, **more: Any) -> None:
        self._ask = ask
        self._log = log
        self._follower = 0
        Node.__init__(self, name, **more)
        LifecycleNodeMixin.__init__(self, callback_group=ReentrantCallbackGroup())
        self._change_state = self._service_change_state.callback
        self._service_change_state.callback = self._on_change_state

    @property
    def lifecycle(self) -> Lifecycle | None:
        """The state of its machine, None during a transition."""
        label = self._state_machine.current_state[1]
        return Lifecycle(label) if label in list(Lifecycle) else None

    def follow(self, bridge: Lifecycle) -> None:
        """Bring the machine to where the bridge is already, without asking for anything."""
        own = self.lifecycle
        if own is None or own is bridge:
            return
        self._follower = threading.get_ident()
        try:
            for step in _WAYS.get((own, bridge), ()):
                getattr(self, f'trigger_{step}')()
        finally:
            self._follower = 0

    # What rclpy calls

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read and check the configuration."""
        return self._do(Do.CONFIGURE, state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start the routes."""
        return self._do(Do.ACTIVATE, state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Drain and commit the routes, and end them."""
        return self._do(Do.DEACTIVATE, state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget the configuration."""
        return self._do(Do.CLEANUP, state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Drain, and end the bridge."""
        return self._do(Do.SHUTDOWN, state)

    def on_error(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Begin at the first state; `follow` goes on from there."""
        return TransitionCallbackReturn.SUCCESS

    def _do(self, do: Do, state: LifecycleState) -> TransitionCallbackReturn:
        if threading.get_ident() == self._follower:
            return TransitionCallbackReturn.SUCCESS
        self._log.info('%s was asked for, by ROS; the bridge is %s', do, state.label)
        answer = self._ask(do)
        if answer.done:
            return TransitionCallbackReturn.SUCCESS
        if not answer.said:
            self._log.error('%s was not done: %s', do, in_one_line(answer))
        # After a failed shutdown the machine would be final, though the bridge goes on.
        return (
            TransitionCallbackReturn.ERROR
            if do is Do.SHUTDOWN
            else TransitionCallbackReturn.FAILURE
        )

    def _on_change_state(self, request: Any, response: Any) -> Any:
        wanted = request.transition.label or request.transition.id
        known = self._state_machine.available_transitions
        # Others are the ends of those that go on.
        possible = [(number, label) for number, label, *_ in known if label in _TRANSITIONS]
        if not any(wanted in one for one in possible):
            self._log.warning('%s', self._refusal(wanted, [label for _, label in possible]))
            response.success = False
            return response
        try:
            with translated('change_state'):
                return self._change_state(request, response)
        except BridgeError as error:  # another request was quicker
            self._log.warning('%s', error)
            response.success = False
            return response

    def _refusal(self, wanted: str | int, possible: Sequence[str]) -> str:
        state = self._state_machine.current_state[1]
        those = ', '.join(sorted(set(possible))) or 'nothing before that has ended'
        return f'ROS asked for transition {wanted!r}: a bridge that is {state} can do {those}'


def in_one_line(answer: Answer) -> str:
    """The text of an answer, for the log."""
    return '; '.join(answer.text.splitlines())
