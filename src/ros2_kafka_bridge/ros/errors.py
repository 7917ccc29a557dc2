"""One table that says for every error of rclpy what is done about it."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import MappingProxyType
from typing import Final

from ros2_kafka_bridge.errors import BridgeError, ConfigError, RouteError, TransportError
from ros2_kafka_bridge.logs.lines import Log

ERROR_CLASSES: Final[Mapping[str, type[BridgeError]]] = MappingProxyType(
    {
        # rclpy's C side
        'InvalidHandle': RouteError,
        'NodeNameNonExistentError': TransportError,
        'NotImplementedError': RouteError,
        'RCLError': RouteError,
        'RCLInvalidROSArgsError': ConfigError,
        'RCUtilsError': RouteError,
        'RMWError': RouteError,
        'TimerCancelledError': RouteError,
        'UnknownROSArgsError': ConfigError,
        'UnsupportedEventTypeError': RouteError,
        # rclpy's Python side
        'InvalidNamespaceException': ConfigError,
        'InvalidNodeNameException': ConfigError,
        'InvalidParameterException': ConfigError,
        'InvalidParameterTypeException': ConfigError,
        'InvalidParameterValueException': ConfigError,
        'InvalidServiceNameException': ConfigError,
        'InvalidTopicNameException': ConfigError,
        'NameValidationException': ConfigError,
        'NoTypeSupportImportedException': ConfigError,
        'NotInitializedException': RouteError,
        'ParameterAlreadyDeclaredException': ConfigError,
        'ParameterException': ConfigError,
        'ParameterImmutableException': ConfigError,
        'ParameterNotDeclaredException': ConfigError,
        'ParameterUninitializedException': ConfigError,
        'ROSInterruptException': RouteError,
    }
)
"""What each exception class of rclpy means, by its name: importing rclpy takes its time."""


def translate(error: Exception, where: str) -> BridgeError | None:
    """Make the bridge's error of one of rclpy's; None if it is not one of them: a bug."""
    kind = ERROR_CLASSES.get(type(error).__name__)
    if kind is None:
        return None
    text = f'{where}: {str(error).split(", at ", maxsplit=1)[0]}'
    return ConfigError([text]) if kind is ConfigError else kind(text)


@contextmanager
def translated(where: str) -> Iterator[None]:
    """Raise the errors of rclpy as the bridge's own; `where` names the endpoint."""
    try:
        yield
    except Exception as error:
        if known := translate(error, where):
            raise known from error
        raise


@contextmanager
def left_behind(log: Log, where: str) -> Iterator[None]:
    """Say what cannot be destroyed, and go on without it."""
    try:
        with translated(where):
            yield
    except BridgeError as error:
        log.warning('%s: left behind', error)
