"""The settings of the formats that have some."""

from typing import Literal

from ros2_kafka_bridge.config.base import Settings, setting, settings


@settings
class JsonSettings(Settings):
    """How JSON is written and read."""

    missing: Literal['error', 'default'] = setting(
        default='error',
        description='What happens if a record lacks a field. error: the record is a dead letter. '
        'default: the field gets the default of the message definition, else zero or empty.',
    )
    unknown: Literal['error', 'ignore'] = setting(
        default='error',
        description='What happens if a record has a field that the message type does not have.',
    )
    bytes: Literal['base64', 'list'] = setting(
        default='base64', description='How uint8[], byte[] and char[] appear.'
    )
    non_finite: Literal['string', 'null', 'error'] = setting(
        default='string',
        description='How NaN and infinity appear. string: as "NaN", "Infinity" and "-Infinity", '
        'which come back. null: as null, which comes back as NaN. error: a message that has one '
        'is a dead letter.',
    )
    integers: Literal['number', 'string'] = setting(
        default='number',
        description='How 64-bit integers appear. Numbers are exact here, but some readers round '
        'those beyond 2^53: use string for these readers.',
    )


@settings
class SchemaSettings(Settings):
    """How avro and protobuf find their schema."""

    registry: bool = setting(
        default=True,
        description='Whether records carry the id of their schema in the Schema Registry. If '
        'false, the schema is fixed: the one of the message type.',
    )
    auto_register: bool = setting(
        default=True,
        description='Whether the bridge registers its schema. If false, the schema must be '
        'registered already.',
    )
    subject: Literal['topic', 'record', 'topic_record'] = setting(
        default='topic', description='What the subject in the Schema Registry is named after.'
    )
