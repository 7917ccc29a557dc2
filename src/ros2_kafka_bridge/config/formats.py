"""The settings of the formats that have some."""

from typing import Literal

from ros2_kafka_bridge.config.base import Settings, setting, settings


@settings
class JsonSettings(Settings):
    """How JSON is written and read."""

    missing: Literal['error', 'default'] = setting(
        'What happens if a record lacks a field. error: the record is a dead letter. '
        'default: the field gets the default of the message definition, else zero or empty.',
        default='error',
    )
    unknown: Literal['error', 'ignore'] = setting(
        'What happens if a record has a field that the message type does not have.',
        default='error',
    )
    bytes: Literal['base64', 'list'] = setting(
        'How uint8[], byte[] and char[] appear.', default='base64'
    )
    non_finite: Literal['string', 'null', 'error'] = setting(
        'How NaN and infinity appear. string: as "NaN", "Infinity" and "-Infinity", '
        'which come back. null: as null, which comes back as NaN. error: a message that has one '
        'is a dead letter.',
        default='string',
    )
    integers: Literal['number', 'string'] = setting(
        'How 64-bit integers appear. Numbers are exact here, but some readers round '
        'those beyond 2^53: use string for these readers.',
        default='number',
    )


@settings
class SchemaSettings(Settings):
    """How avro and protobuf find their schema."""

    registry: bool = setting(
        'Whether records carry the id of their schema in the Schema Registry. If '
        'false, the schema is fixed: the one of the message type.',
        default=True,
    )
    auto_register: bool = setting(
        'Whether the bridge registers its schema. If false, the schema must be '
        'registered already.',
        default=True,
    )
    subject: Literal['topic', 'record', 'topic_record'] = setting(
        'What the subject in the Schema Registry is named after.', default='topic'
    )
