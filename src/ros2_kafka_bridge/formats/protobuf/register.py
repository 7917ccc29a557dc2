"""Schemas of messages that the bridge writes: registered, or looked up, before the first one."""

import re
from typing import Any, Final

from confluent_kafka.schema_registry import Schema, SchemaReference, SchemaRegistryClient
from confluent_kafka.schema_registry.error import SchemaRegistryError
from confluent_kafka.schema_registry.protobuf import ProtobufSerializer
from confluent_kafka.schema_registry.serde import SchemaId
from confluent_kafka.serialization import MessageField, SerializationContext

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.formats.protobuf.schema import make_files, protobuf_sources
from ros2_kafka_bridge.formats.registry import open_registry, strategy, subject
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.message_types.layout import Layout


def registered(layout: Layout, message_class: Any, scope: Scope) -> bytes:
    """Register the schema of a message type, with those of the types in it as references.

    Returns:
        What stands before each message: the id of the schema, and which message of it.

    Raises:
        ConfigError: The registry does not have the schema, or refuses it.
        RouteError: The registry does not answer.
    """
    registry = open_registry(scope)
    auto_register = scope.schema.auto_register
    properties = {
        'auto.register.schemas': auto_register,
        # Else a schema that differs in its order alone would be another version.
        'normalize.schemas': True,
        'subject.name.strategy.type': strategy(scope),
    }
    serializer = ProtobufSerializer(message_class, registry.client, properties)
    where = subject(scope, layout)
    context = SerializationContext(scope.topic, MessageField.VALUE)
    told = registry.registering(where, layout.type_name, 'protobuf', auto_register=auto_register)
    with registry.client, told:
        try:
            # An empty message is no bytes: what is left is what stands before.
            return bytes(serializer(message_class(), context) or b'')
        except SchemaRegistryError as error:
            if _DESCRIPTOR.search(error.error_message or ''):
                raise ConfigError([_cannot_compare(layout, registry.url, where)]) from error
            if auto_register or error.http_status_code != 404:
                raise
        return _source_prefix(layout, registry.client, where)


# Apicurio takes a descriptor, and parses it as source text where it has to compare it: what it
# cannot parse it says in full.
_DESCRIPTOR: Final = re.compile(r'[A-Za-z0-9+/]{100}')


def _cannot_compare(layout: Layout, url: str, where: str) -> str:
    printed = f'ros2-kafka-bridge schema {layout.type_name} --format protobuf'
    return (
        f'Schema Registry {url}, subject {where}: the registry cannot compare a descriptor with '
        'the versions that are there, and takes it for source text: take the compatibility rule '
        f'off the subject, or register what `{printed}` prints, and set schema: '
        '{auto_register: false}'
    )


def _source_prefix(layout: Layout, client: SchemaRegistryClient, where: str) -> bytes:
    """Looks the schema up as the source text that the bridge prints.

    The serializer has descriptors; not every registry knows that they are the same.
    """
    *inner, root = make_files(layout)
    sources = protobuf_sources(layout)
    references: dict[str, SchemaReference] = {}

    def schema_of(file: Any) -> Schema:
        imported = [references[name] for name in file.dependency if name in references]
        return Schema(sources[file.name], 'PROTOBUF', imported)

    for file in inner:
        found = client.lookup_schema(file.name, schema_of(file), normalize_schemas=True)
        references[file.name] = SchemaReference(file.name, file.name, found.version)
    found = client.lookup_schema(where, schema_of(root), normalize_schemas=True)
    return SchemaId('PROTOBUF', found.schema_id, None, [0]).id_to_bytes()
