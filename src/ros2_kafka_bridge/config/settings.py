"""The whole configuration, with the names of all settings classes: for loader, docs and editor."""

from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar, cast, get_args, get_type_hints

from annotated_types import MinLen

from ros2_kafka_bridge.config import checks
from ros2_kafka_bridge.config.base import Settings, Values, look, masked_values, setting, settings
from ros2_kafka_bridge.config.endpoints import (
    FromKafka,
    FromRos,
    QoS,
    RosSettings,
    SpoolSettings,
    ToKafka,
    ToRos,
)
from ros2_kafka_bridge.config.formats import JsonSettings, SchemaSettings
from ros2_kafka_bridge.config.groups import group_mistakes
from ros2_kafka_bridge.config.mistakes import MISTAKES_TOLD, Mistake, field_names, near
from ros2_kafka_bridge.config.monitoring import MonitoringSettings, TracingSettings
from ros2_kafka_bridge.config.registry import SchemaRegistrySettings
from ros2_kafka_bridge.config.routes import (
    BLOCKS,
    TEXT_TYPE,
    AnyRoute,
    KafkaToRosRoute,
    RosToKafkaRoute,
    Route,
    model_of,
)
from ros2_kafka_bridge.config.values import (
    BridgeName,
    CheckFormat,
    CheckKafka,
    PositiveCount,
    Properties,
)
from ros2_kafka_bridge.kafka.addresses import servers_problem
from ros2_kafka_bridge.kafka.properties import (
    Membership,
    PropertyValue,
    canonical,
    code_of_others,
    is_secret,
)
from ros2_kafka_bridge.outside.masking import MASK

__all__ = [
    'Config',
    'FromKafka',
    'FromRos',
    'JsonSettings',
    'KafkaToRosRoute',
    'MonitoringSettings',
    'QoS',
    'RosSettings',
    'RosToKafkaRoute',
    'Route',
    'SchemaRegistrySettings',
    'SchemaSettings',
    'SpoolSettings',
    'ToKafka',
    'ToRos',
    'TracingSettings',
    'masked',
    'warnings',
]

_Model = TypeVar('_Model', bound=Settings)

_SINKS_LIMIT = 500
_OWN = ('name', 'from', 'to')
_SAMPLES: dict[type[Settings], dict[str, Any]] = {
    KafkaToRosRoute: {'from': {'kafka': 'x'}, 'to': {'ros': '/x', 'type': TEXT_TYPE}},
    RosToKafkaRoute: {'from': {'ros': '/x'}, 'to': {'kafka': 'x'}},
}


@settings
class Config(Settings):
    """One bridge: a Kafka cluster, a ROS domain, and the routes between them."""

    name: BridgeName = setting(
        'Name of this bridge, without a dot. It is part of consumer groups, the '
        'origin header and the node name.'
    )
    kafka: Properties = setting(
        'librdkafka properties, by their own names. bootstrap.servers is required.'
    )
    membership: Membership = setting(
        'static: the members of consumer groups have names, by which they get their '
        'places back at once after an outage of Kafka. dynamic: they have no names.',
        default='static',
    )
    ros: RosSettings = setting('The ROS side.', default_factory=RosSettings)
    schema_registry: SchemaRegistrySettings | None = setting(
        'The Schema Registry of the formats avro and protobuf.', default=None
    )
    monitoring: MonitoringSettings | None = setting(
        'What the bridge shows of itself: metrics, health, a page, a ROS node.', default=None
    )
    tracing: TracingSettings | None = setting(
        'Traces through the bridge, by W3C trace context and OpenTelemetry.', default=None
    )
    workers: PositiveCount = setting(
        'Processes that share the routes, at most one for each route.', default=1
    )
    defaults: dict[str, Any] = setting(
        'Fields for all routes that can have them: any field of a route except name, from and to.',
        default_factory=dict,
    )
    routes: Annotated[list[AnyRoute], MinLen(1)] = setting(
        'At least one route, each with from and to.'
    )

    @property
    def to_ros(self) -> list[KafkaToRosRoute]:
        """The routes from Kafka to ROS, in the order of the file."""
        return [route for route in self.routes if isinstance(route, KafkaToRosRoute)]

    @property
    def to_kafka(self) -> list[RosToKafkaRoute]:
        """The routes from ROS to Kafka, in the order of the file."""
        return [route for route in self.routes if isinstance(route, RosToKafkaRoute)]

    @classmethod
    def prepared(cls, data: Any) -> Any:
        """Each route with the defaults that fit it."""
        if not isinstance(data, Mapping) or not isinstance(data.get('routes'), list):
            return data
        known = _known_defaults(data)
        wrong = {mistake.path[1] for mistake in _default_mistakes(known)}
        right = {name: value for name, value in known.items() if name not in wrong}
        return {**data, 'routes': [_with(right, route) for route in data['routes']]}

    @classmethod
    def mistakes(cls, given: Values, context: Values, /) -> Iterator[Mistake]:
        """Mistakes in the defaults, between the routes, and in librdkafka's eyes."""
        kafka, defaults, routes = given.get('kafka'), given.get('defaults'), given.get('routes')
        routes = routes if isinstance(routes, list) else []
        if isinstance(defaults, Mapping):
            yield from _default_mistakes(defaults)
        yield from _route_mistakes(routes)
        known = _known_defaults(given)
        whole = [_with(known, route) for route in routes]
        yield from group_mistakes(str(given.get('name')), whole)
        if given.get('schema_registry') is None:
            yield from _registry_mistakes(whole)
        yield from _extra_mistakes(given, context)
        if isinstance(kafka, Mapping):
            if not any(canonical(name) == 'bootstrap.servers' and kafka[name] for name in kafka):
                text = 'is missing: the brokers, such as localhost:9092'
                yield Mistake(('kafka', 'bootstrap.servers'), text)
            yield from _server_mistakes(kafka)
            if check := context.get('check_kafka'):
                yield from _kafka_mistakes(check, kafka, routes)


def _server_mistakes(kafka: Mapping[Any, Any]) -> Iterator[Mistake]:
    """Lists of brokers in which there is none, or another than was meant."""
    protocol = kafka.get('security.protocol') or 'plaintext'
    for name, servers in kafka.items():
        is_list = canonical(name) == 'bootstrap.servers' and servers
        if is_list and (problem := servers_problem(str(servers), str(protocol))):
            yield Mistake(('kafka', name), problem)


def _extra_mistakes(given: Values, context: Values) -> Iterator[Mistake]:
    """What is asked for and lacks its libraries here."""
    check: CheckFormat | None = context.get('check_format')
    listens = given.get('monitoring') is not None and look(given, 'monitoring', 'listen') != 'off'
    if check and listens and (problem := check('monitoring')):
        yield Mistake(('monitoring',), f'unless it says listen: off, {problem}')


def _with(defaults: Values, route: Any) -> Any:
    if not isinstance(route, Mapping):
        return route
    name = route.get('format', defaults.get('format'))
    others = {block for block, formats in BLOCKS.items() if name not in formats}
    fields = field_names(model_of(route)).keys() - others
    return {name: value for name, value in defaults.items() if name in fields} | dict(route)


def _default_mistakes(defaults: Values) -> Iterator[Mistake]:
    """Each wrong default once, wherever it would be used."""
    for number, (name, value) in enumerate(defaults.items()):
        models = [model for model in _SAMPLES if name in field_names(model)]
        if name in _OWN:
            yield Mistake(('defaults', name), 'has no default: every route says its own')
        elif models:
            yield from _default_mistake(models[0], name, value)
        else:
            hint = near(name, _default_names()) if number < MISTAKES_TOLD else ''
            yield Mistake(('defaults', name), f"unknown field '{name}'{hint}")


def _known_defaults(data: Values) -> dict[str, Any]:
    """Those of a file's defaults that some route can have."""
    given, names = data.get('defaults'), _default_names()
    return {n: v for n, v in given.items() if n in names} if isinstance(given, Mapping) else {}


def _default_names() -> set[str]:
    return {field for model in _SAMPLES for field in field_names(model)}


def _default_mistake(model: type[Settings], name: str, value: Any) -> Iterator[Mistake]:
    format_name = BLOCKS.get(name, ('text',))[0]
    from ros2_kafka_bridge.config.validation import attempted  # noqa: PLC0415 (heavy: only to read a file)

    sample = {'name': 'x', 'format': format_name, **_SAMPLES[model], name: value}
    for mistake in attempted(model, sample)[1]:
        yield Mistake(('defaults', *mistake.path), mistake.text)


def _route_mistakes(routes: list[Any]) -> Iterator[Mistake]:
    for number, first in checks.repeats([look(route, 'name') for route in routes]).items():
        yield Mistake(('routes', number, 'name'), f'repeats the name of routes[{first}]')
    edges = [
        (number, str(source), str(sink))
        for number, route in enumerate(routes)
        for source in [look(route, 'from', 'kafka') or look(route, 'from', 'ros')]
        for sink in [look(route, 'to', 'kafka') or look(route, 'to', 'ros')]
        if source and sink and source != sink
    ]
    for number, cycle in checks.cycles(edges).items():
        yield Mistake(('routes', number), f'closes a cycle of routes: {" -> ".join(cycle)}')


def _registry_mistakes(routes: list[Any]) -> Iterator[Mistake]:
    for number, route in enumerate(routes):
        name = look(route, 'format')
        fixed = look(route, 'schema', 'registry') is False
        if name in BLOCKS['schema'] and not fixed:
            text = (
                f'{name} looks its schema up in a Schema Registry, and this file names '
                'none: add schema_registry: {url: ...} at the top, or to this route '
                'schema: {registry: false}, which fixes the schema of the message type'
            )
            yield Mistake(('routes', number, 'format'), text)


def _kafka_mistakes(check: CheckKafka, kafka: Values, routes: list[Any]) -> Iterator[Mistake]:
    """What librdkafka refuses: in the properties of all, then with those of each sink."""
    problems, secrets = check(_scalars(kafka), None), _secrets(kafka)
    for name, text in problems.items():
        yield Mistake(('kafka', name), _hidden(text, secrets))
    right = {name: value for name, value in kafka.items() if name not in problems}
    yield from _sink_mistakes(check, right, routes, secrets)


def _sink_mistakes(
    check: CheckKafka, right: Values, routes: list[Any], secrets: list[str]
) -> Iterator[Mistake]:
    """What it refuses in the properties of a sink beside the right ones of all."""
    known: dict[str, Mapping[str, str]] = {}
    told = 0
    for number, route in enumerate(routes):
        if told > MISTAKES_TOLD:
            return
        own = look(route, 'to', 'properties')
        if not isinstance(own, Mapping) or not own:
            continue
        # Not checked yet, a value may be a list, which is no key of a dictionary.
        same = repr(sorted((str(name), value) for name, value in own.items()))
        if same not in known and len(known) == _SINKS_LIMIT:
            continue  # each takes a client; what is wrong there is told as its route begins
        if same not in known:
            others = {name: value for name, value in right.items() if name not in own}
            known[same] = check(_scalars(own), _scalars(others))
        told += len(known[same])
        for name, text in known[same].items():
            path = ('properties', name) if name in own else ('properties',)
            yield Mistake(
                ('routes', number, 'to', *path), _hidden(text, [*secrets, *_secrets(own)])
            )


def _scalars(properties: Values) -> dict[str, object]:
    return {n: v for n, v in properties.items() if isinstance(v, str | int | float)}


def _secrets(properties: Values) -> list[str]:
    return [str(v) for n, v in properties.items() if is_secret(str(n)) and len(str(v)) > 2]


def _hidden(text: str, secrets: list[str]) -> str:
    for secret in secrets:
        text = text.replace(secret, MASK)
    return text


def restored(values: Values) -> Config:
    """A configuration that was checked before.

    Args:
        values: What `config.validation.plain` made of it.
    """
    routes = [_restored(model_of(route), route) for route in values['routes']]
    return _restored(Config, {**values, 'routes': routes})


def _restored(model: type[_Model], values: Values) -> _Model:
    kinds = get_type_hints(model)
    return model(
        **{
            name: _restored_value(kinds[name], values[spelled])
            for spelled, name in field_names(model).items()
        }
    )


def _restored_value(kind: Any, value: Any) -> Any:
    kinds = (kind, *get_args(kind))
    if Path in kinds:
        return [Path(item) for item in value]
    model = next((one for one in kinds if is_dataclass(one)), None)
    is_plain = model is None or not isinstance(value, Mapping)
    return value if is_plain else _restored(cast('type[Settings]', model), value)


def masked(config: Config) -> dict[str, Any]:
    """The configuration as in its file, defaults merged, every secret masked: to be printed."""
    from ros2_kafka_bridge.config.validation import plain  # noqa: PLC0415 (heavy)

    shown: dict[str, Any] = masked_values(plain(config, without_none=True))
    return shown


def warnings(config: Config) -> list[str]:
    """What the configuration gives up, a sentence for each guarantee that falls, and what it runs.

    The numbers are those of the guarantees in the documentation.
    """
    found = [f'kafka.{text}' for text in _property_warnings(config.kafka)]
    if config.schema_registry is not None and config.schema_registry.ssl_ca_location is False:
        found.append('schema_registry.ssl.ca.location: false: nobody checks who the registry is')
    if config.to_ros and config.ros.confirmation == 'none':
        found.append(
            'ros.confirmation: none: guarantee 1 falls: offsets follow the publication, and what '
            'is lost on its way to a reader, or in the writer at a stop, stays lost'
        )
    for number, route in enumerate(config.routes):
        path = f'routes[{number}]'
        if isinstance(route, RosToKafkaRoute):
            said = _property_warnings(route.sink.properties)
            found += [f'{path}.to.properties.{text}' for text in said]
            found += [f'{path}.from.qos.{text}' for text in _weaker_qos(route.source.qos, 2)]
        else:
            found += [f'{path}.to.qos.{text}' for text in _weaker_qos(route.sink.qos, 1)]
    return found


def _property_warnings(properties: Mapping[str, PropertyValue]) -> Iterator[str]:
    yield from checks.weaker_properties(properties)
    yield from code_of_others(properties)


def _weaker_qos(qos: QoS, guarantee: int) -> Iterator[str]:
    if qos.reliability == 'best_effort':
        yield f'reliability: best_effort: guarantee {guarantee} falls: what is lost stays lost'
    if qos.history == 'keep_last':
        yield 'history: keep_last: guarantee 4 (full means wait) falls: a full history overwrites'
        if guarantee == 1:
            yield 'history: keep_last: guarantee 1 falls: nothing tells what has arrived'
    if qos.lifespan_s is not None:
        yield f'lifespan_s: guarantee {guarantee} falls: what waits longer is dropped'
