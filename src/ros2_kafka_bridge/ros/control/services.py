"""The services and parameters of the bridge's node, which follow its configuration.

Imports rclpy: import it where ROS is needed for sure.
"""

import threading
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple, Protocol

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from ros2_kafka_bridge import __version__
from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.logs.lines import Log
from ros2_kafka_bridge.protocol.monitor import Answer, Do
from ros2_kafka_bridge.ros.control.lifecycle import in_one_line
from ros2_kafka_bridge.ros.control.route_names import ros_names

_RELOADS: Final = {'reload': Do.RELOAD, 'preview_reload': Do.PREVIEW}
_PAUSES: Final = {'pause': Do.PAUSE, 'resume': Do.RESUME}


class _Ask(Protocol):
    def __call__(self, do: Do, route: str = '') -> Answer: ...


class _Offered(NamedTuple):
    """What exists for one route."""

    shown: dict[str, str]
    services: tuple[Any, ...]


class Offers:
    """Makes and removes services and parameters; all but the callbacks in one thread.

    Args:
        node: The node that has them.
        ask: Asks the bridge, and waits until it was done; may be called from any thread.
        log: Says what was asked for.
    """

    def __init__(self, node: Any, ask: _Ask, log: Log) -> None:
        self._node = node
        self._ask = ask
        self._log = log
        self._names: dict[str, str] = {}
        self._offered: dict[str, _Offered] = {}
        self._thread = threading.get_ident()
        self._pausing = MutuallyExclusiveCallbackGroup()
        self._shown: dict[str, str] = {}
        reloading = MutuallyExclusiveCallbackGroup()
        for name, do in _RELOADS.items():
            node.create_service(Trigger, f'~/{name}', self._answers(do), callback_group=reloading)
        node.add_on_set_parameters_callback(self._on_set)

    def offer(self, config: Config, file: str, routes: Sequence[AnyRoute]) -> None:
        """Offer what fits a configuration, and nothing that does not."""
        self._show({'bridge_name': config.name, 'config_file': file, 'version': __version__})
        names = ros_names(route.name for route in routes)
        wanted = {names[route.name]: _shown(route) for route in routes}
        for name in [n for n, it in self._offered.items() if wanted.get(n) != it.shown]:
            self._withdraw(name)
        for name, shown in wanted.items():
            if name not in self._offered:
                self._offer(name, shown)
        self._names = {name: shown['name'] for name, shown in wanted.items()}

    def follow(self, paused: Sequence[str]) -> None:
        """Show which routes are paused."""
        for name, route in self._names.items():
            parameter, now = f'routes.{name}.paused', route in paused
            if self._node.get_parameter(parameter).value != now:
                self._node.set_parameters([Parameter(parameter, value=now)])

    # Routes

    def _offer(self, name: str, shown: dict[str, str]) -> None:
        route = shown['name']
        if name != route:
            self._log.info('route %s is called %s in names of ROS', route, name)
        for key, value in shown.items():
            self._declare(f'routes.{name}.{key}', value)
        text = 'Whether nothing is moved: set it to pause and to resume.'
        descriptor = ParameterDescriptor(description=text)
        self._node.declare_parameter(f'routes.{name}.paused', False, descriptor)  # noqa: FBT003
        services = tuple(
            self._node.create_service(
                Trigger,
                f'~/{name}/{verb}',
                self._answers(do, route),
                callback_group=self._pausing,
            )
            for verb, do in _PAUSES.items()
        )
        self._offered[name] = _Offered(shown, services)

    def _withdraw(self, name: str) -> None:
        gone = self._offered.pop(name)
        for service in gone.services:
            self._node.destroy_service(service)
        for key in (*gone.shown, 'paused'):
            self._undeclare(f'routes.{name}.{key}')

    # Parameters

    def _show(self, shown: dict[str, str]) -> None:
        for name, value in shown.items():
            if self._shown.get(name) != value:
                if name in self._shown:
                    self._undeclare(name)
                self._declare(name, value)
        self._shown = shown

    def _declare(self, name: str, value: str) -> None:
        text = 'From the configuration file: change it there, and reload.'
        descriptor = ParameterDescriptor(description=text, read_only=True)
        self._node.declare_parameter(name, value, descriptor, ignore_override=True)

    def _undeclare(self, name: str) -> None:
        # rclpy hands out the descriptor that it looks at: what is read-only stays for ever else.
        self._node.describe_parameter(name).read_only = False
        self._node.undeclare_parameter(name)

    def _on_set(self, parameters: Sequence[Any]) -> SetParametersResult:
        """Pause and resume as the parameters say: all of them or, at the first refusal, none."""
        if threading.get_ident() == self._thread:
            return SetParametersResult(successful=True)
        done: list[tuple[Do, str]] = []
        for parameter in parameters:
            route = self._route_of(parameter.name)
            if route is None:  # rclpy's own, such as use_sim_time
                continue
            if not isinstance(parameter.value, bool):
                self._undo(done)
                text = f'{parameter.name} is true or false, and stays while its route does'
                return SetParametersResult(successful=False, reason=text)
            do = Do.PAUSE if parameter.value else Do.RESUME
            answer = self._asked(do, route)
            if not answer.done:
                self._undo(done)
                return SetParametersResult(successful=False, reason=answer.text)
            done.append((do, route))
        return SetParametersResult(successful=True)

    def _route_of(self, parameter: str) -> str | None:
        prefix, _, rest = parameter.partition('.')
        name, _, key = rest.partition('.')
        return self._names.get(name) if (prefix, key) == ('routes', 'paused') else None

    def _undo(self, done: Sequence[tuple[Do, str]]) -> None:
        for do, route in reversed(done):
            self._asked(Do.RESUME if do is Do.PAUSE else Do.PAUSE, route)

    # Services

    def _answers(self, do: Do, route: str = '') -> Callable[[Any, Any], Any]:
        def answer(_: Any, response: Any) -> Any:
            told = self._asked(do, route)
            response.success = told.done
            response.message = '\n'.join([told.text, *told.changes])
            return response

        return answer

    def _asked(self, do: Do, route: str) -> Answer:
        about = f'{do} of {route}' if route else str(do)
        if do is not Do.PREVIEW:
            self._log.info('%s was asked for, by ROS', about)
        answer = self._ask(do, route)
        if not answer.done and not answer.said:
            self._log.warning('%s, asked for by ROS, was not done: %s', about, in_one_line(answer))
        return answer


def _shown(route: AnyRoute) -> dict[str, str]:
    source, sink = route.topics
    return {
        'name': route.name,
        'source': source,
        'sink': sink,
        'type': route.type_name or '',
        'format': str(route.format),
    }
