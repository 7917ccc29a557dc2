"""json: the schema that is printed of a type."""

import json
import math
from typing import Literal

import pytest
from support.formats.messages import layout_of

from ros2_kafka_bridge.config.formats import JsonSettings
from ros2_kafka_bridge.formats.json import schema
from ros2_kafka_bridge.message_types import document
from ros2_kafka_bridge.message_types.layout import (
    Array,
    Constant,
    Field,
    Layout,
    Primitive,
    Sequence,
    String,
)


def test_the_schema_is_json_schema_with_what_the_definition_says() -> None:
    layout = Layout(
        'odd_msgs/msg/Cell',
        (
            Field('level', Primitive('uint8'), default=7, doc='From 0 to 100.'),
            Field('ids', Sequence(Primitive('uint64'), bound=4)),
            Field('matrix', Array(Primitive('float32'), 2)),
            Field('at', Layout('odd_msgs/msg/Point', (Field('x', Primitive('float64')),))),
        ),
        doc='One cell.',
        type_hash='RIHS01_' + 64 * 'a',
    )
    said = json.loads(schema(layout, JsonSettings(missing='default')))
    cell = said['$defs']['odd_msgs_msg_Cell']
    assert said['$schema'] == 'https://json-schema.org/draft/2020-12/schema'
    assert said['$ref'] == '#/$defs/odd_msgs_msg_Cell'
    assert (cell['title'], cell['description']) == ('odd_msgs/msg/Cell', 'One cell.')
    assert cell['ros.type_hash'] == layout.type_hash
    assert cell['properties'] == {
        'level': {
            'type': 'integer',
            'minimum': 0,
            'maximum': 255,
            'description': 'From 0 to 100.',
            'default': 7,
        },
        'ids': {
            'type': 'array',
            'items': {'type': 'integer', 'minimum': 0, 'maximum': 2**64 - 1},
            'maxItems': 4,
            'default': [],
        },
        'matrix': {
            'type': 'array',
            'items': {
                'anyOf': [
                    {
                        'type': 'number',
                        'minimum': -3.4028234663852886e38,
                        'maximum': 3.4028234663852886e38,
                    },
                    {'enum': ['-Infinity', 'Infinity', 'NaN']},
                ]
            },
            'minItems': 2,
            'maxItems': 2,
            'default': [0.0, 0.0],
        },
        'at': {'$ref': '#/$defs/odd_msgs_msg_Point'},
    }


def test_the_schema_follows_the_settings() -> None:
    layout = layout_of('sensor_msgs/msg/CompressedImage')
    name = 'sensor_msgs_msg_CompressedImage'
    strict = json.loads(schema(layout, JsonSettings()))['$defs'][name]
    loose = JsonSettings(missing='default', unknown='ignore', bytes='list')
    lenient = json.loads(schema(layout, loose))['$defs'][name]
    assert strict['required'] == ['header', 'format', 'data']
    assert strict['additionalProperties'] is False
    assert strict['properties']['data'].items() >= {'contentEncoding': 'base64'}.items()
    assert lenient['required'] == []
    assert 'additionalProperties' not in lenient
    assert lenient['properties']['data']['items']['maximum'] == 255


@pytest.mark.parametrize('non_finite', ['string', 'null', 'error'])
def test_the_schema_is_json_where_constants_and_defaults_are_not_finite(
    non_finite: Literal['string', 'null', 'error'],
) -> None:
    kind = Primitive('float64')
    constants = (
        Constant('NONE', kind, math.nan),
        Constant('MOST', kind, math.inf),
        Constant('NAME', String(), 'nan'),
    )
    layout = Layout('demo_msgs/msg/One', (Field('v', kind, math.nan),), constants)
    text = schema(layout, JsonSettings(missing='default', non_finite=non_finite))
    assert 'NaN,' not in text.replace('"NaN",', '')
    found = json.loads(text)['$defs']['demo_msgs_msg_One']
    assert found['ros.constants'] == {'NONE': 'NaN', 'MOST': 'Infinity', 'NAME': 'nan'}
    default = {'string': 'NaN', 'null': None, 'error': 'no default'}
    assert found['properties']['v'].get('default', 'no default') == default[non_finite]


def test_the_schema_has_the_comments_and_constants_of_the_definition() -> None:
    layout = document(layout_of('sensor_msgs/msg/NavSatFix'))
    said = json.loads(schema(layout, JsonSettings()))['$defs']
    fix = said['sensor_msgs_msg_NavSatFix']
    status = said['sensor_msgs_msg_NavSatStatus']
    assert 'Latitude [degrees]' in fix['properties']['latitude']['description']
    assert fix['description'].startswith('Navigation Satellite fix')
    assert fix['ros.constants']['COVARIANCE_TYPE_KNOWN'] == 3
    assert status['ros.constants']['STATUS_NO_FIX'] == -1
    assert fix['ros.type_hash'] == layout.type_hash
    assert status['ros.type_hash'].startswith('RIHS01_')
