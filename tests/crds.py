"""Custom resources, looked at as strictly as an API server does, by what defines their kind."""

from typing import Any, Final

from jsonschema import Draft4Validator

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
