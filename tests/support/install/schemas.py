"""As much of JSON Schema and of custom resources as our own files need, looked at strictly."""

import re
from typing import Any, Final

from jsonschema import Draft4Validator

_TYPES: dict[str, tuple[type, ...]] = {
    'string': (str,),
    'integer': (int,),
    'number': (int, float),
    'boolean': (bool,),
    'null': (type(None),),
    'array': (list,),
    'object': (dict,),
}
_SILENT = {'$schema', '$defs', 'default', 'description', 'title', 'format', 'writeOnly',
           'contentEncoding'}  # fmt: skip
_CHECKED = {
    '$ref', 'anyOf', 'type', 'enum', 'const', 'minimum', 'maximum', 'exclusiveMinimum',
    'minLength', 'minItems', 'items', 'required', 'properties', 'additionalProperties',
    'maxLength', 'maxItems', 'pattern',
}  # fmt: skip


def schema_problems(root: dict[str, Any], value: Any) -> list[str]:
    """What the schema refuses in a value; an unknown keyword fails the test."""
    return _problems(root, root, value, '')


def _problems(root: dict[str, Any], schema: dict[str, Any], value: Any, path: str) -> list[str]:
    unknown = {name for name in schema if not name.startswith('ros.')} - _SILENT - _CHECKED
    assert not unknown, f'keywords that this check does not know: {unknown}'
    found = []
    if '$ref' in schema:
        target = root['$defs'][schema['$ref'].removeprefix('#/$defs/')]
        found += _problems(root, target, value, path)
    if 'anyOf' in schema and all(_problems(root, s, value, path) for s in schema['anyOf']):
        found.append(f'{path}: none of the alternatives')
    if 'type' in schema and not _is_type(schema['type'], value):
        return [*found, f'{path}: no {schema["type"]}']
    if value not in schema.get('enum', [value]):
        found.append(f'{path}: none of the values')
    return [
        *found,
        *_number_problems(schema, value, path),
        *_list_problems(root, schema, value, path),
        *_object_problems(root, schema, value, path),
    ]


def _is_type(name: str, value: Any) -> bool:
    return isinstance(value, _TYPES[name]) and (name == 'boolean' or not isinstance(value, bool))


def _number_problems(schema: dict[str, Any], value: Any, path: str) -> list[str]:
    if not _is_type('number', value):
        return []
    wrong = (
        value < schema.get('minimum', value)
        or value > schema.get('maximum', value)
        or ('exclusiveMinimum' in schema and value <= schema['exclusiveMinimum'])
    )
    return [f'{path}: out of range'] if wrong else []


def _list_problems(
    root: dict[str, Any], schema: dict[str, Any], value: Any, path: str
) -> list[str]:
    if isinstance(value, str | list) and len(value) < max(
        schema.get('minItems', 0) * isinstance(value, list),
        schema.get('minLength', 0) * isinstance(value, str),
    ):
        return [f'{path}: too short']
    most = schema.get('maxItems' if isinstance(value, list) else 'maxLength')
    if isinstance(value, str | list) and most is not None and len(value) > most:
        return [f'{path}: too long']
    if isinstance(value, str) and not re.search(schema.get('pattern', ''), value):
        return [f'{path}: does not match']
    if not isinstance(value, list) or 'items' not in schema:
        return []
    return [
        problem
        for place, item in enumerate(value)
        for problem in _problems(root, schema['items'], item, f'{path}[{place}]')
    ]


def _object_problems(
    root: dict[str, Any], schema: dict[str, Any], value: Any, path: str
) -> list[str]:
    if not isinstance(value, dict):
        return []
    found = [f'{path}.{name}: missing' for name in schema.get('required', []) if name not in value]
    for name, item in value.items():
        part = schema.get('properties', {}).get(name, schema.get('additionalProperties', True))
        if part is False:
            found.append(f'{path}.{name}: unknown')
        elif isinstance(part, dict):
            found += _problems(root, part, item, f'{path}.{name}')
    return found


_OPEN: Final = 'x-kubernetes-preserve-unknown-fields'


def problems(definition: dict[str, Any], resource: dict[str, Any]) -> list[str]:
    """What is wrong with a resource; its metadata, which every kind has, is not looked at.

    Args:
        definition: A CustomResourceDefinition.
        resource: One of its kind.
    """
    group, _, version = resource['apiVersion'].rpartition('/')
    spec = definition['spec']
    assert (group, resource['kind']) == (spec['group'], spec['names']['kind'])
    [schema] = [
        one['schema']['openAPIV3Schema']
        for one in spec['versions']
        if one['name'] == version and one['served']
    ]
    strict = _strict(schema)
    strict['properties']['metadata'] = {'type': 'object'}
    found = Draft4Validator(strict).iter_errors(resource)
    return [f'{error.json_path}: {error.message}' for error in found]


def _strict(schema: dict[str, Any]) -> dict[str, Any]:
    """A schema that refuses a field which it does not name: an API server would drop that."""
    found = {name: value for name, value in schema.items() if not name.startswith('x-kubernetes-')}
    if schema.get('x-kubernetes-int-or-string'):
        found['type'] = ['integer', 'string']
    if 'properties' in schema:
        found['properties'] = {k: _strict(v) for k, v in schema['properties'].items()}
    if 'items' in schema:
        found['items'] = _strict(schema['items'])
    more = schema.get('additionalProperties')
    if isinstance(more, dict):
        found['additionalProperties'] = _strict(more)
    elif schema.get('type') == 'object' and not schema.get(_OPEN):
        found['additionalProperties'] = False
    return found
