"""The command line as `ros2 run` and launch give it: own arguments, and those of ROS."""

import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from ros2_kafka_bridge.errors import ConfigError

ROS_ARGUMENTS: Final = 'ROS2_KAFKA_BRIDGE_ROS_ARGS'
"""Where the ROS arguments stand for the process that has the bridge's node, as a list in JSON."""

_BEGIN: Final = '--ros-args'
_END: Final = '--'
_PARAMETER: Final = ('-p', '--param')
_FILE: Final = '--params-file'
_CONFIG: Final = 'config'


class Arguments(NamedTuple):
    """A command line, taken apart.

    Args:
        own: What the bridge's own command line reads.
        ros: What stood between `--ros-args` and `--`, or the end.
    """

    own: tuple[str, ...]
    ros: tuple[str, ...]


def taken_apart(arguments: Sequence[str]) -> Arguments:
    """Tell the bridge's own arguments from those of ROS, which may come in several runs."""
    own: list[str] = []
    ros: list[str] = []
    target = own
    for argument in arguments:
        if argument == _BEGIN:
            target = ros
        elif argument == _END and target is ros:
            target = own
        else:
            target.append(argument)
    return Arguments(tuple(own), tuple(ros))


def config_parameter(ros: Sequence[str]) -> str | None:
    """The parameter `config`: given by itself, or in a file of parameters, the last one counts.

    Raises:
        ConfigError: A file of parameters cannot be read.
    """
    found = None
    for option, value in itertools.pairwise(ros):
        if option in _PARAMETER and value.startswith(f'{_CONFIG}:='):
            found = value.partition(':=')[2]
        elif option == _FILE:
            found = _in_file(Path(value)) or found
    return found


def _in_file(file: Path) -> str | None:
    try:
        content = YAML(typ='safe', pure=True).load(file)
    except (OSError, UnicodeDecodeError, YAMLError) as error:
        raise ConfigError([f'{file}: the ROS parameters cannot be read: {error}']) from error
    return next((str(found) for found in _configs(content)), None)


def _configs(content: Any) -> Iterator[Any]:
    """What any node of a file has for `config`, however deep its name is."""
    if not isinstance(content, dict):
        return
    for name, inner in content.items():
        if name == 'ros__parameters' and isinstance(inner, dict):
            if _CONFIG in inner:
                yield inner[_CONFIG]
        else:
            yield from _configs(inner)
