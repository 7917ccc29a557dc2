"""The settings of the formats that have some."""

from typing import Literal

from ros2_kafka_bridge.config.base import Settings, setting, settings


@settings
class JsonSettings(Settings):
    """How JSON is written and read."""

    missing: Literal['error', 'default'] = setting(
        default='error',
        description='A field that a record does not have: error makes it a dead letter, default '
        'takes the value that the message definition says, else zero or empty.',
    )
    unknown: Literal['error', 'ignore'] = setting(
        default='error', description='A field that the message type does not have.'
    )
    bytes: Literal['base64', 'list'] = setting(
        default='base64', description='How uint8[], byte[] and char[] appear.'
    )
    non_finite: Literal['string', 'null', 'error'] = setting(
        default='string',
        description='How NaN and infinity appear: as "NaN", "Infinity" and "-Infinity", which '
        'come back; as null, which comes back as NaN; or as an error.',
    )
    integers: Literal['number', 'string'] = setting(
        default='number',
        description='How 64-bit integers appear. As numbers they are exact here; some readers '
        'round what is beyond 2^53, and string is for them.',
    )


@settings
class SchemaSettings(Settings):
    """How avro and protobuf find their schema."""

    registry: bool = setting(
        default=True,
        description='Whether records carry the id of their schema in the Schema Registry. '
        'Without it the schema is fixed: the one of the message type.',
    )
    auto_register: bool = setting(
        default=True,
        description='Whether the bridge registers its schema; else it must be registered already.',
    )
    subject: Literal['topic', 'record', 'topic_record'] = setting(
        default='topic', description='What the subject is named after in the Schema Registry.'
    )
