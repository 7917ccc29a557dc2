"""Types and records of protobuf with a Schema Registry."""

from typing import Any

from confluent_kafka.schema_registry import SchemaRegistryClient
from confluent_kafka.schema_registry.protobuf import ProtobufSerializer
from confluent_kafka.serialization import MessageField, SerializationContext
from support.registry.server import RegistryServer

from ros2_kafka_bridge.config.formats import SchemaSettings
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.message_types.layout import Field, Kind, Layout, Primitive

VALUE = SerializationContext('robots', MessageField.VALUE)
BY_TOPIC = {'subject.name.strategy.type': 'TOPIC'}


def scope(server: RegistryServer, **settings: Any) -> Scope:
    return Scope('robots', schema=SchemaSettings(**settings), registry={'url': server.url})


def mine(*fields: tuple[str, Kind], name: str = 'robot/msg/Mine') -> Layout:
    return Layout(name, tuple(Field(*field) for field in fields))


def serialized(server: RegistryServer, message: Any) -> bytes:
    """A record as confluent's serializer writes it."""
    with SchemaRegistryClient({'url': server.url}) as client:
        serialize: Any = ProtobufSerializer(type(message), client, BY_TOPIC)
        record: bytes = serialize(message, VALUE)
    return record


NUMBER = mine(('number', Primitive('int32')))
# A small number of NUMBER, as CDR.
SEVEN = b'\0\1\0\0\7\0\0\0'
