"""What `check` finds of a route's format: whether it carries the type, and what a Schema Registry
says to its schema. Nothing is registered.
"""

import json
from collections.abc import Iterator
from contextlib import AbstractContextManager, closing
from dataclasses import replace
from typing import TYPE_CHECKING, Final, NamedTuple

from ros2_kafka_bridge.commands.screen import Finding
from ros2_kafka_bridge.config.direction import Direction
from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.errors import BridgeError, ConfigError
from ros2_kafka_bridge.formats import FORMATS
from ros2_kafka_bridge.formats.avro.schema import avro_schema
from ros2_kafka_bridge.formats.registry import Registry, framed_id, open_registry, subject
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.formats.values.structs import Style, make_structs
from ros2_kafka_bridge.formats.values.write import make_write
from ros2_kafka_bridge.message_types.layout import Layout
from ros2_kafka_bridge.route.format import asks_registry, scope_of, with_docs

if TYPE_CHECKING:
    from confluent_kafka.schema_registry import RegisteredSchema


def format_findings(route: AnyRoute, config: Config, layout: Layout | None) -> list[Finding]:
    """Whether the format carries the type, without asking anybody."""
    if layout is None:
        return []
    scope = scope_of(route, config)
    fixed = scope._replace(schema=replace(scope.schema, registry=False))
    chosen = FORMATS[route.format]
    make = {Direction.KAFKA_TO_ROS: chosen.make_decode, Direction.ROS_TO_KAFKA: chosen.make_encode}
    try:
        make[route.direction](with_docs(route, config, layout), fixed)
    except BridgeError as error:
        return [Finding('bad', 'format', str(error))]
    return [Finding('ok', 'format', f'{route.format} carries {layout.type_name}')]


def registry_findings(route: AnyRoute, config: Config, layout: Layout | None) -> Iterator[Finding]:
    """What the Schema Registry says to the schema of a route."""
    if not asks_registry(route) or layout is None:
        return
    scope = scope_of(route, config)
    try:
        whole = with_docs(route, config, layout)
        asking = _Asking(open_registry(scope), scope, whole, route.format)
        with closing(asking.registry.client):
            yield _LOOKS[route.direction](asking)
    except BridgeError as error:
        yield Finding('bad', 'registry', str(error))


class _Asking(NamedTuple):
    """What is asked about: the schema of a type, in its subject."""

    registry: Registry
    scope: Scope
    layout: Layout
    schema_format: str

    @property
    def subject(self) -> str:
        return subject(self.scope, self.layout)

    @property
    def where(self) -> str:
        return f'subject {self.subject} of {self.registry.url}'

    def latest(self) -> 'RegisteredSchema | None':
        """The last version of the subject; None where there is none.

        Raises:
            BridgeError: The registry does not answer, or not to this user.
        """
        from confluent_kafka.schema_registry.error import (  # noqa: PLC0415 (heavy)
            SchemaRegistryError,
        )

        with self.errors():
            try:
                return self.registry.client.get_latest_version(self.subject)
            except SchemaRegistryError as error:
                if error.http_status_code != 404:
                    raise
                return None

    def fits(self) -> bool:
        """Whether a new version for Avro would be compatible.

        Raises:
            BridgeError: The registry does not answer, or not to this user.
        """
        from confluent_kafka.schema_registry import Schema  # noqa: PLC0415 (heavy)

        own = Schema(json.dumps(avro_schema(self.layout)), 'AVRO')
        with self.errors():
            return self.registry.client.test_compatibility(self.subject, own)

    def errors(self) -> AbstractContextManager[None]:
        """Make errors of the bridge of the client's."""
        return self.registry.registering(
            self.subject, self.layout.type_name, self.schema_format, auto_register=True
        )


def _read(asking: _Asking) -> Finding:
    """What is there to be read: each record names its own version."""
    latest = asking.latest()
    if latest is None:
        return Finding('note', 'registry', f'{asking.where} has no schema yet')
    text = f'{asking.where} has version {latest.version}, id {latest.schema_id}'
    return Finding('ok', 'registry', text)


def _written(asking: _Asking) -> Finding:
    """Whether the schema is there, or could be registered."""
    try:
        found = _registered_id(asking)
    except ConfigError:
        if not asking.scope.schema.auto_register:
            raise
        return _registrable(asking)
    return Finding('ok', 'registry', f'{asking.where} has the schema, with the id {found}')


def _registered_id(asking: _Asking) -> int:
    """The id of the schema, looked up as the route does it.

    Raises:
        ConfigError: It is not registered.
    """
    schema = replace(asking.scope.schema, auto_register=False)
    encode = FORMATS[asking.schema_format].make_encode(
        asking.layout, asking.scope._replace(schema=schema)
    )
    style = Style(missing='default')
    empty = make_structs(asking.layout, style)[asking.layout.type_name]()
    return framed_id(encode(make_write(asking.layout, style)(empty)) or b'')


def _registrable(asking: _Asking) -> Finding:
    latest = asking.latest()
    if latest is None:
        text = f'{asking.where} is new: the schema is registered at the start'
        return Finding('ok', 'registry', text)
    text = f'{asking.where} has version {latest.version} of another schema'
    if asking.schema_format != 'avro':
        # The schemas of its parts have to be registered before this can be asked.
        text = f'{text}: whether this one is compatible is seen at the start'
        return Finding('note', 'registry', text)
    if asking.fits():
        text = f'{text}: this one is compatible, and is registered at the start'
        return Finding('ok', 'registry', text)
    cure = 'change the compatibility of the subject, or use another subject'
    return Finding('bad', 'registry', f'{text}, and this one is not compatible', cure)


_LOOKS: Final = {Direction.KAFKA_TO_ROS: _read, Direction.ROS_TO_KAFKA: _written}
