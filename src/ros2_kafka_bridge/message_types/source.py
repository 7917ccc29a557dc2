"""Where the description of a message type comes from: folders, what is installed, nodes.

The first of them that has the type counts; where the graph shows how it is defined, the first
that has it so.
"""

import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final, Self

from ros2_kafka_bridge.config.endpoints import RosSettings
from ros2_kafka_bridge.errors import ConfigError, RouteError
from ros2_kafka_bridge.message_types import describe, unknown_type
from ros2_kafka_bridge.message_types.description import DescribedTypes, type_hash

Ask = Callable[[str, str], DescribedTypes]
"""Type, hash -> what a node that uses it says of it; or a RouteError, where none does."""

Definitions = Mapping[str, str]
"""Each hash that the graph shows for a type -> who uses that, in words."""

CURE: Final = 'put its .msg files into a folder of ros.message_path, or install its package'
"""What to do where nobody describes a type."""

NOT_SHOWN: Final[Definitions] = MappingProxyType({})


_MOST_FIELDS: Final = 50_000
"""Of all that nodes have described to this process: what endpoints are made of stays."""


class TypeSource:
    """The descriptions of types; what a node has told is kept. Any thread may call.

    Args:
        message_path: Folders of .msg files.
    """

    def __init__(self, message_path: Sequence[Path] = ()) -> None:
        self.folders = tuple(message_path)
        self._lock = threading.Lock()
        self._told: dict[tuple[str, str], DescribedTypes] = {}
        self._fields = 0  # of what was told

    @classmethod
    def of(cls, ros: RosSettings, over: Sequence[Path] = ()) -> Self:
        """What is known where a file has these settings, and nobody is asked.

        Args:
            ros: The settings.
            over: Folders that come before those of the settings.
        """
        # What is imported has the fields of its package, whatever a folder says.
        return cls([*over, *(() if ros.packages == 'import' else ros.message_path)])

    def unknown(self, name: str) -> str | None:
        """Why no folder and no package has a type, and what is near it; None where one has."""
        return unknown_type(name, self.folders)

    def unsettled(self, name: str) -> str | None:
        """Why those who use a type have to show how it is defined; None where they need not."""
        problem = self.unknown(name)
        if problem or not self.folders:
            return problem
        known, _ = self._known(name)
        if len({type_hash(name, one.types) for one in known}) < 2:
            return None
        return f'{name} {known[0].origin} otherwise than it is installed here'

    def describe(
        self, name: str, definitions: Definitions = NOT_SHOWN, ask: Ask | None = None
    ) -> DescribedTypes:
        """The description of a type.

        Args:
            name: As `tf2_msgs/msg/TFMessage`.
            definitions: As the graph shows them. One that is known here comes first, then what a
                node tells; where none tells it, what is known here counts, and messages of another
                definition are refused one by one.
            ask: Asks the nodes; None asks nobody.

        Raises:
            ConfigError: No folder and no package has it, or not in a way that can be read.
            RouteError: No node tells it, or the graph shows two definitions.
        """
        known, problem = self._known(name)
        for found in known:
            if not definitions or type_hash(name, found.types) in definitions:
                return found
        try:
            if ask is not None:
                return self._asked(name, definitions, ask)
        except RouteError as error:
            if not known:
                raise RouteError(f'{problem}, and {error}') from error
        if known:
            return known[0]
        assert problem is not None, 'that is why it is not known'
        raise problem

    def _known(self, name: str) -> tuple[list[DescribedTypes], ConfigError | None]:
        """What the folders say of it, then what is installed; or why there is neither."""
        try:
            known = [describe(name, self.folders)]
        except ConfigError as error:
            return [], error
        if self.folders and unknown_type(name) is None:
            known.append(describe(name))
        return known, None

    def _asked(self, name: str, definitions: Definitions, ask: Ask) -> DescribedTypes:
        if not definitions:
            raise RouteError(
                'nobody there tells how it is defined (a bridge does not, nor a program that is '
                f'no ROS node): {CURE}'
            )
        if len(definitions) > 1:
            users = '; '.join(f'{it} by {users}' for it, users in sorted(definitions.items()))
            raise RouteError(
                f'nodes define it in {len(definitions)} ways: {users}: build them with one '
                'version of its package, or put the .msg files of the right one into a folder of '
                'ros.message_path'
            )
        [wanted] = definitions
        with self._lock:
            told = self._told.get((name, wanted))
        if told is None:
            told = ask(name, wanted)
            self._keep(name, wanted, told)
        return told

    def _keep(self, name: str, wanted: str, told: DescribedTypes) -> None:
        fields = sum(len(one.fields) for one in told.types.values())
        with self._lock:
            if self._fields + fields > _MOST_FIELDS:
                raise RouteError(
                    f'nodes have described types of {_MOST_FIELDS:,} fields to this process, and '
                    f'no more are taken: {CURE}; and restart the bridge'
                )
            self._fields += fields
            self._told[name, wanted] = told
