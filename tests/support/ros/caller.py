"""A node of the test that calls the services of a bridge's node and hears its diagnostics."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import Trigger
from support.patience import patient
from support.processes.harness import Bench, Process, eventually

from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.node import open_node

PATIENCE_S = 60.0
AGAIN_S = 2.0


class Caller:
    """Calls one bridge's node.

    Args:
        node: Of the test.
        executor: That spins it.
        name: Of the bridge's node, with its namespace.
    """

    def __init__(self, node: Any, executor: Any, name: str) -> None:
        self._node = node
        self._executor = executor
        self._name = name
        self._clients: dict[str, Any] = {}
        self._diagnostics: list[DiagnosticArray] = []
        node.create_subscription(DiagnosticArray, '/diagnostics', self._diagnostics.append, 10)

    def start(self, kind: Any, service: str, **request: Any) -> Any:
        """Call a service; returns the future of its answer."""
        if service not in self._clients:
            self._clients[service] = self._client(kind, service)
        return self._clients[service].call_async(kind.Request(**request))

    def _client(self, kind: Any, service: str) -> Any:
        """Make a client that the bridge knows.

        A client sees a service before the service has seen where the client wants its answer, and
        rmw_fastrtps drops an answer with no place to go ("client will not receive response").
        DDS announces endpoints in their order: when a younger client is answered, this one is
        known, too.
        """
        client = self._node.create_client(kind, f'{self._name}/{service}')
        assert client.wait_for_service(patient(PATIENCE_S)), f'no service {self._name}/{service}'
        younger = self._node.create_client(GetState, f'{self._name}/get_state')
        assert younger.wait_for_service(patient(PATIENCE_S)), f'no service {self._name}/get_state'
        eventually(lambda: self._answers(younger), PATIENCE_S, lambda: 'no answer')
        self._node.destroy_client(younger)
        return client

    def _answers(self, younger: Any) -> bool:
        future = younger.call_async(GetState.Request())
        self._executor.spin_until_future_complete(future, AGAIN_S)
        return bool(future.done())

    def wait(self, future: Any) -> Any:
        """Wait for an answer."""
        self._executor.spin_until_future_complete(future, patient(PATIENCE_S))
        assert future.done(), 'no answer'
        return future.result()

    def call(self, kind: Any, service: str, **request: Any) -> Any:
        """Call a service, and wait for its answer."""
        return self.wait(self.start(kind, service, **request))

    def trigger(self, service: str) -> tuple[bool, str]:
        """Call a service that needs nothing; returns whether it was done, and the words."""
        answer = self.call(Trigger, service)
        return answer.success, answer.message

    # Lifecycle

    @property
    def state(self) -> str:
        """What `ros2 lifecycle get` says."""
        return str(self.call(GetState, 'get_state').current_state.label)

    def change(self, label: str) -> bool:
        """What `ros2 lifecycle set` does; returns whether it was done."""
        return bool(self.wait(self.begin(label)).success)

    def begin(self, label: str) -> Any:
        """Ask for a transition; returns the future of its answer."""
        return self.start(ChangeState, 'change_state', transition=Transition(label=label))

    # Parameters

    def parameters(self) -> dict[str, Any]:
        """All of them."""
        names = self.call(ListParameters, 'list_parameters').result.names
        values = self.call(GetParameters, 'get_parameters', names=names).values
        return {name: _value(value) for name, value in zip(names, values, strict=True)}

    def assign(self, name: str, *, value: bool | str) -> tuple[bool, str]:
        """Set a parameter; returns whether it was taken, and why not."""
        made = (
            ParameterValue(type=ParameterType.PARAMETER_BOOL, bool_value=value)
            if isinstance(value, bool)
            else ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=value)
        )
        parameters = [Parameter(name=name, value=made)]
        [result] = self.call(SetParameters, 'set_parameters', parameters=parameters).results
        return result.successful, result.reason

    # Diagnostics

    def diagnostics(self) -> dict[str, Any]:
        """The next ones, by what they are about."""
        self._diagnostics.clear()
        deadline = time.monotonic() + patient(PATIENCE_S)
        while not self._diagnostics:
            assert time.monotonic() < deadline, 'no diagnostics'
            self._executor.spin_once(0.1)
        return {s.name.partition(': ')[2]: s for s in self._diagnostics[-1].status}

    def wait_for(self, about: str, level: int, text: str) -> Any:
        """Wait for diagnostics of that level, with that text in their message."""
        last: dict[str, Any] = {}

        def there() -> bool:
            last.update(self.diagnostics())
            status = last.get(about)
            return status is not None and status.level == bytes([level]) and text in status.message

        eventually(there, PATIENCE_S, lambda: str(last.get(about)))
        return last[about]

    def services(self) -> set[str]:
        """Those of the bridge's node, without its name."""
        prefix = f'{self._name}/'
        known = (name for name, _ in self._node.get_service_names_and_types())
        return {name.removeprefix(prefix) for name in known if name.startswith(prefix)}


def _value(value: Any) -> Any:
    return value.bool_value if value.type == ParameterType.PARAMETER_BOOL else value.string_value


@contextmanager
def caller(domain: int, name: str) -> Iterator[Caller]:
    """Make a node that calls the bridge's node of that name."""
    with open_node('caller', domain, Histories({}, {})) as node:
        executor = SingleThreadedExecutor(context=node.context)
        executor.add_node(node.handle)
        yield Caller(node.handle, executor, name)
        executor.shutdown()


@contextmanager
def controlled(
    bench: Bench, config: Path, *, python: Path | None = None
) -> Iterator[tuple[Process, Caller]]:
    """A bridge whose node is active, and who calls that."""
    with (
        bench.bridge(config, python=python) as bridge,
        caller(bench.domain, bench.node) as node,
    ):
        eventually(lambda: node.state == 'active', 60, bridge.output)
        yield bridge, node
