"""The settings: the only place where one is spelled, for the loader, the docs and the editor."""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationError, ValidationInfo, model_validator

from ros2_kafka_bridge.config import checks
from ros2_kafka_bridge.config.endpoints import (
    KafkaSink,
    KafkaSource,
    QoS,
    RosSettings,
    RosSink,
    RosSource,
    SpoolSettings,
)
from ros2_kafka_bridge.config.values import (
    CheckKafka,
    Count,
    CountOrNone,
    Name,
    NotNegative,
    Positive,
    Properties,
)
from ros2_kafka_bridge.config.words import (
    MASK,
    Mistake,
    Settings,
    field_names,
    kind_of,
    look,
    masked_values,
    mistakes_in,
    near,
    refused,
)
from ros2_kafka_bridge.kafka.properties import canonical, is_secret

__all__ = [
    'Config',
    'KafkaSink',
    'KafkaSource',
    'KafkaToRosRoute',
    'QoS',
    'RosSettings',
    'RosSink',
    'RosSource',
    'RosToKafkaRoute',
    'Route',
    'SpoolSettings',
    'masked',
    'warnings',
]

TEXT_TYPE = 'std_msgs/msg/String'


class Route(Settings):
    """What the routes of both directions share."""

    name: Name = Field(description='Name of the route, once in a file.')
    format: Literal['text', 'cdr'] = Field(
        description=f"How a record's value encodes a message: text ({TEXT_TYPE} only) or cdr."
    )
    when_full: Literal['wait', 'drop_oldest'] = Field(
        'wait', description='What happens when the sink takes no more: nothing is lost with wait.'
    )
    on_error: Literal['dead_letter', 'stop', 'drop'] = Field(
        'dead_letter', description='What happens to what can never be delivered.'
    )
    max_in_flight: Count = Field(
        1, description='Messages handed to the sink and not yet confirmed, at most.'
    )
    max_in_flight_bytes: Count = Field(
        16 * 1024 * 1024, description='Bytes handed to the sink and not yet confirmed, at most.'
    )
    max_message_bytes: Count = Field(
        1_000_000, description='Largest message or value of a record, in bytes.'
    )
    drain_s: NotNegative = Field(
        8, description='Longest time for the drain at a stop, in seconds.'
    )

    @classmethod
    def mistakes(
        cls, given: Mapping[str, Any], _context: Mapping[str, Any], /
    ) -> Iterator[Mistake]:
        """The text format carries one type only."""
        for side in ('from', 'to'):
            message_type = look(given, side, 'type')
            if given.get('format') == 'text' and message_type not in {None, TEXT_TYPE}:
                text = f'format: text carries {TEXT_TYPE} only: another type needs format: cdr'
                yield Mistake((side, 'type'), text)


class KafkaToRosRoute(Route):
    """A route from Kafka to ROS."""

    source: KafkaSource = Field(alias='from', description='Kafka topic to read.')
    sink: RosSink = Field(alias='to', description='ROS topic to publish to.')
    max_in_flight: Count = Field(
        500, description='Messages published and not yet confirmed, at most.'
    )
    min_subscribers: CountOrNone = Field(
        1, description='Subscribers to wait for before publishing; with 0 to nobody, too.'
    )
    max_age_s: Positive | None = Field(
        None, description='Age at which a record is dropped, not published, in seconds.'
    )
    max_rate: Positive | None = Field(
        None, description='Messages per second at most, for readers with keep_last.'
    )

    def group(self, bridge: str) -> str:
        """The consumer group of this route in the bridge of that name."""
        return self.source.group or f'{bridge}.{self.name}'

    @property
    def dead_letter_topic(self) -> str:
        """The Kafka topic for what can never be delivered."""
        return self.source.dead_letter or self.source.kafka + checks.DEAD_LETTER_SUFFIX


class RosToKafkaRoute(Route):
    """A route from ROS to Kafka."""

    source: RosSource = Field(alias='from', description='ROS topic to take from.')
    sink: KafkaSink = Field(alias='to', description='Kafka topic to write.')
    max_in_flight: Count = Field(
        2000, description='Records produced and not yet confirmed, at most.'
    )
    spool: SpoolSettings | None = Field(
        None, description='Where messages wait on disk while Kafka does not take them.'
    )

    exclusive: bool = Field(
        False,  # noqa: FBT003 (its default)
        description='Several bridges run this file, and one at a time runs this route: another '
        'takes over when it dies.',
    )

    @property
    def dead_letter_topic(self) -> str:
        """The Kafka topic for what can never be delivered."""
        return self.sink.dead_letter or self.sink.kafka + checks.DEAD_LETTER_SUFFIX


_ENDPOINTS: dict[tuple[str, str], type[Settings]] = {
    ('from', 'kafka'): KafkaSource,
    ('from', 'ros'): RosSource,
    ('to', 'kafka'): KafkaSink,
    ('to', 'ros'): RosSink,
}
_WORDS = {'kafka': 'Kafka', 'ros': 'ROS'}
_EXAMPLES = {'kafka': '{kafka: orders}', 'ros': '{ros: /orders}'}
_OTHER = {'kafka': 'ros', 'ros': 'kafka', 'from': 'to', 'to': 'from'}


def _kind(route: Mapping[str, Any], side: str) -> str | None:
    """The kind of topic on one side of an unchecked route, None where that is not clear."""
    end = route.get(side)
    kinds = [kind for kind in _WORDS if kind in end] if isinstance(end, Mapping) else []
    return kinds[0] if len(kinds) == 1 else None


def _model(route: Mapping[str, Any]) -> type[KafkaToRosRoute | RosToKafkaRoute]:
    source = _kind(route, 'from') or _OTHER.get(_kind(route, 'to') or '', 'kafka')
    return KafkaToRosRoute if source == 'kafka' else RosToKafkaRoute


def _by_direction(value: Any, info: ValidationInfo) -> Any:
    if isinstance(value, Route):
        return value
    if not isinstance(value, Mapping):
        raise ValueError(f'expected a mapping, got {kind_of(value)}')  # noqa: TRY004  # pydantic's
    model = _model(value)
    found = [*_side_mistakes(value), *_misplaced(model, value)]
    known = {mistake.path for mistake in found}
    try:
        made = model.model_validate(value, context=info.context)
    except ValidationError as error:
        new = mistakes_in(model, error)
        found += [m for m in new if m.path not in known and m.path[:1] not in known]
    if found:
        raise refused(model.__name__, found)
    return made


def _side_mistakes(route: Mapping[str, Any]) -> Iterator[Mistake]:
    """What keeps a route from having one topic in Kafka and one in ROS."""
    for side in ('from', 'to'):
        end, other = route.get(side), _kind(route, _OTHER[side])
        right = _EXAMPLES[_OTHER[other]] if other else ' or '.join(_EXAMPLES.values())
        if end is None:
            yield Mistake((side,), f'is missing: a topic such as {right}')
        elif not isinstance(end, Mapping):
            yield Mistake((side,), f'expected a mapping such as {right}, got {kind_of(end)}')
        elif all(kind in end for kind in _WORDS):
            yield Mistake((side,), 'names both a kafka and a ros topic: a side is one of them')
        elif _kind(route, side) is None:
            hint = next((found for word in end for found in [near(word, _WORDS)] if found), '')
            yield Mistake((side,), f'names no topic, such as {right}{hint}')
    if (kind := _kind(route, 'from')) and kind == _kind(route, 'to'):
        text = f'both sides are {_WORDS[kind]}: a route joins Kafka and ROS, such as '
        yield Mistake(('to',), text + _EXAMPLES[_OTHER[kind]])


def _misplaced(model: type[Settings], route: Mapping[str, Any]) -> Iterator[Mistake]:
    """Fields that exist, but not for this direction or side, and Python's names in a file."""
    for name, right in (('source', 'from'), ('sink', 'to')):
        if name in route:
            yield Mistake((name,), f"unknown field '{name}' (did you mean '{right}'?)")
    words = ('ROS to Kafka', 'Kafka to ROS')[:: 1 if model is RosToKafkaRoute else -1]
    other = KafkaToRosRoute if model is RosToKafkaRoute else RosToKafkaRoute
    for name in route.keys() & (field_names(other).keys() - field_names(model).keys()):
        text = f'only a route from {words[1]} has it, this one goes from {words[0]}'
        yield Mistake((name,), text)
    for side in ('from', 'to'):
        kind = _kind(route, side)
        for name in route[side] if kind else ():
            yield from _misplaced_in_end(side, kind or '', name)


def _misplaced_in_end(side: str, kind: str, name: str) -> Iterator[Mistake]:
    if name in field_names(_ENDPOINTS[side, kind]):
        return
    for (right_side, right_kind), model in _ENDPOINTS.items():
        if name in field_names(model):
            where = f"only a {_WORDS[right_kind]} topic in '{right_side}' has it"
            yield Mistake((side, name), f"{where}, this is a {_WORDS[kind]} topic in '{side}'")
            return


AnyRoute = Annotated[KafkaToRosRoute | RosToKafkaRoute, BeforeValidator(_by_direction)]

_OWN = ('name', 'from', 'to')
_SAMPLES: dict[type[Settings], dict[str, Any]] = {
    KafkaToRosRoute: {'from': {'kafka': 'x'}, 'to': {'ros': '/x', 'type': TEXT_TYPE}},
    RosToKafkaRoute: {'from': {'ros': '/x'}, 'to': {'kafka': 'x'}},
}


class Config(Settings):
    """One bridge: a Kafka cluster, a ROS domain, and the routes between them."""

    name: Name = Field(
        description='Name of this bridge: in consumer groups, the origin header, the node name.'
    )
    kafka: Properties = Field(
        description='librdkafka properties, by their own names. bootstrap.servers is required.'
    )
    ros: RosSettings = Field(default_factory=RosSettings, description='The ROS side.')
    workers: Count = Field(1, description='Processes that share the routes, at most one for each.')
    defaults: dict[str, Any] = Field(
        default_factory=dict,
        description='Any field of a route but name, from and to, for the routes that it fits.',
    )
    routes: list[AnyRoute] = Field(
        min_length=1, description='At least one route, each with from and to.'
    )

    @model_validator(mode='before')
    @classmethod
    def _with_defaults(cls, data: Any) -> Any:
        if not isinstance(data, Mapping) or not isinstance(data.get('routes'), list):
            return data
        defaults = data.get('defaults')
        given = defaults if isinstance(defaults, Mapping) else {}
        wrong = {mistake.path[1] for mistake in _default_mistakes(given)}
        right = {name: value for name, value in given.items() if name not in wrong}
        return {**data, 'routes': [_with(right, route) for route in data['routes']]}

    @classmethod
    def mistakes(
        cls, given: Mapping[str, Any], context: Mapping[str, Any], /
    ) -> Iterator[Mistake]:
        """Mistakes in the defaults, between the routes, and in librdkafka's eyes."""
        kafka, defaults, routes = given.get('kafka'), given.get('defaults'), given.get('routes')
        routes = routes if isinstance(routes, list) else []
        if isinstance(defaults, Mapping):
            yield from _default_mistakes(defaults)
        yield from _route_mistakes(routes)
        if isinstance(kafka, Mapping):
            if not any(canonical(name) == 'bootstrap.servers' and kafka[name] for name in kafka):
                text = 'is missing: the brokers, such as localhost:9092'
                yield Mistake(('kafka', 'bootstrap.servers'), text)
            if check := context.get('check_kafka'):
                yield from _kafka_mistakes(check, kafka, routes)


def _with(defaults: Mapping[str, Any], route: Any) -> Any:
    if not isinstance(route, Mapping):
        return route
    fields = field_names(_model(route))
    return {name: value for name, value in defaults.items() if name in fields} | dict(route)


def _default_mistakes(defaults: Mapping[str, Any]) -> Iterator[Mistake]:
    """Each wrong default once, wherever it would be used."""
    for name, value in defaults.items():
        models = [model for model in _SAMPLES if name in field_names(model)]
        if name in _OWN:
            yield Mistake(('defaults', name), 'has no default: every route says its own')
        elif models:
            yield from _default_mistake(models[0], name, value)
        else:
            known = {field for model in _SAMPLES for field in field_names(model)}
            text = f"unknown field '{name}'{near(name, known)}"
            yield Mistake(('defaults', name), text)


def _default_mistake(model: type[Settings], name: str, value: Any) -> Iterator[Mistake]:
    try:
        model.model_validate({'name': 'x', 'format': 'text', **_SAMPLES[model], name: value})
    except ValidationError as error:
        for mistake in mistakes_in(model, error):
            yield Mistake(('defaults', *mistake.path), mistake.text)


def _route_mistakes(routes: list[Any]) -> Iterator[Mistake]:
    for number, first in checks.repeats([look(route, 'name') for route in routes]).items():
        yield Mistake(('routes', number, 'name'), f'repeats the name of routes[{first}]')
    readers = [(look(r, 'from', 'group'), look(r, 'from', 'kafka')) for r in routes]
    for number, first in checks.repeats([r if r[0] else None for r in readers]).items():
        text = f'routes[{first}] reads this topic in the same group: each would get a part only'
        yield Mistake(('routes', number, 'from', 'group'), text)
    edges = [
        (number, str(source), str(sink))
        for number, route in enumerate(routes)
        for source in [look(route, 'from', 'kafka') or look(route, 'from', 'ros')]
        for sink in [look(route, 'to', 'kafka') or look(route, 'to', 'ros')]
        if source and sink and source != sink
    ]
    for number, cycle in checks.cycles(edges).items():
        yield Mistake(('routes', number), f'closes a cycle of routes: {" -> ".join(cycle)}')


def _kafka_mistakes(
    check: CheckKafka, kafka: Mapping[str, Any], routes: list[Any]
) -> Iterator[Mistake]:
    """What librdkafka refuses: in the properties of all, then with those of each sink."""
    problems = check(_scalars(kafka))
    for name, text in problems.items():
        yield Mistake(('kafka', name), _hidden(text, kafka))
    right = {name: value for name, value in kafka.items() if name not in problems}
    for number, route in enumerate(routes):
        own = look(route, 'to', 'properties')
        for name, text in check(_scalars({**right, **own})).items() if own else ():
            path = ('properties', name) if name in own else ('properties',)
            yield Mistake(('routes', number, 'to', *path), _hidden(text, {**kafka, **own}))


def _scalars(properties: Mapping[str, Any]) -> dict[str, object]:
    return {n: v for n, v in properties.items() if isinstance(v, str | int | float)}


def _hidden(text: str, properties: Mapping[str, Any]) -> str:
    for name, value in properties.items():
        if is_secret(name) and len(str(value)) > 2:
            text = text.replace(str(value), MASK)
    return text


def masked(config: Config) -> dict[str, Any]:
    """The configuration as in its file, defaults merged, every secret masked: to be printed."""
    shown: dict[str, Any] = masked_values(
        config.model_dump(mode='json', by_alias=True, exclude_none=True)
    )
    return shown


def warnings(config: Config) -> list[str]:
    """What the configuration gives up: one sentence for each guarantee that falls.

    The numbers are those of the guarantees in the documentation.
    """
    found = [f'kafka.{text}' for text in checks.weaker_properties(config.kafka)]
    for number, route in enumerate(config.routes):
        path = f'routes[{number}]'
        if isinstance(route, RosToKafkaRoute):
            weaker = checks.weaker_properties(route.sink.properties)
            found += [f'{path}.to.properties.{text}' for text in weaker]
            found += [f'{path}.from.qos.{text}' for text in _weaker_qos(route.source.qos, 2)]
        else:
            found += [f'{path}.to.qos.{text}' for text in _weaker_qos(route.sink.qos, 1)]
    return found


def _weaker_qos(qos: QoS, guarantee: int) -> Iterator[str]:
    if qos.reliability == 'best_effort':
        yield f'reliability: best_effort: guarantee {guarantee} falls: what is lost stays lost'
    if qos.history == 'keep_last':
        yield 'history: keep_last: guarantee 4 (full means wait) falls: a full history overwrites'
    if qos.lifespan_s is not None:
        yield f'lifespan_s: guarantee {guarantee} falls: what waits longer is dropped'
