"""What librdkafka refuses of properties, found by clients that know no broker.

Nothing that a file says is run for it, no code is loaded, nobody on the network is asked.
"""

from __future__ import annotations

import difflib
import logging
import re
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Final, Literal

from ros2_kafka_bridge.kafka.properties import (
    AWS,
    KNOWN,
    TOKEN_SOURCE,
    PropertyValue,
    canonical,
    consumer_properties,
    file_fault,
    is_classic,
    is_secret,
    plain_value,
    producer_properties,
    refusal,
    runs_code,
)
from ros2_kafka_bridge.kafka.tls_files import refused_file

if TYPE_CHECKING:
    from collections.abc import Mapping

_Kind = Literal['producer', 'consumer']

# Without a command of its own librdkafka gets a ticket by kinit.
_NO_TICKETS: Final[dict[str, PropertyValue]] = {'sasl.kerberos.min.time.before.relogin': 0}
_PAIRS: Final = ('ssl.key.', 'ssl.certificate.')
_OF_PROVIDERS: Final = ('ssl.key.', 'ssl.keystore.', 'ssl.certificate.')

_TOKEN_METHOD: Final = 'sasl.oauthbearer.method'  # noqa: S105 (a name)
_TOKEN_SETTINGS: Final = 'sasl.oauthbearer.config'  # noqa: S105 (a name)
_TOKEN_URL: Final = 'sasl.oauthbearer.token.endpoint.url'  # noqa: S105 (a name)
# A client asks for a token as soon as it is made, by a proxy of the environment if there is one:
# without a host nobody is asked.
_NOWHERE: Final = 'http://'

_PROPERTIES_LIMIT: Final = 1000

_PROTOCOL: Final = 'group.protocol'
_KIP_848_MENDED: Final = (2, 15)

_CREATION = re.compile(r'^Failed to create (producer|consumer): ')
_NO_NAME: Final = '-'
_KNOWS_ALL_ELSE: Final = f'No such configuration property: "{_NO_NAME}"'


def property_problems(
    properties: Mapping[str, object], common: Mapping[str, object] | None = None
) -> dict[str, str]:
    """What librdkafka would refuse.

    Args:
        properties: By librdkafka's names, as the user wrote them.
        common: Right ones beside them, where the properties are those of one sink.

    Returns:
        A sentence for each wrong property; no secret value is ever part of it.
    """
    if len(properties) > _PROPERTIES_LIMIT:
        last = list(properties)[_PROPERTIES_LIMIT]
        return {last: f'more than {_PROPERTIES_LIMIT} properties: librdkafka knows some 200'}
    usable = {n: plain_value(v) for n, v in properties.items() if refusal(n) is None}
    problems: dict[str, str] = {}
    for name, value in usable.items():
        if fault := file_fault(name, str(value)):
            problems[name] = fault
        elif (error := _refused_alone(name, value)) is not None:
            problems[name] = _sentence(name, value, error)
    if common is None and _PROTOCOL not in problems and (old := _outdated(usable)):
        problems[_PROTOCOL] = old
    # Without its partner a key or a certificate would be told to be wrong, too.
    pairs = _PAIRS if any(n.startswith(_PAIRS) for n in problems) else ()
    right = {n: v for n, v in usable.items() if n not in problems and not n.startswith(pairs)}
    shared = {n: plain_value(v) for n, v in (common or {}).items() if refusal(n) is None}
    kinds: tuple[_Kind, ...] = ('producer', 'consumer') if common is None else ('producer',)
    if TOKEN_SOURCE in right and (missing := _aws_problem({**shared, **right})):
        problems[TOKEN_SOURCE] = missing
    for name, problem in _together({**shared, **right}, kinds).items():
        problems.setdefault(name, problem)
    return problems


def _outdated(properties: Mapping[str, PropertyValue]) -> str | None:
    from confluent_kafka import libversion  # noqa: PLC0415  # slow

    told: object = libversion()
    # confluent-kafka 2.12.0 tells the text alone, others a number beside it.
    return group_protocol_fault(properties, str(told[0] if isinstance(told, tuple) else told))


def group_protocol_fault(properties: Mapping[str, PropertyValue], librdkafka: str) -> str | None:
    """Why the brokers must not be left to say who reads what (KIP-848), None where they may.

    Args:
        properties: Those of a consumer.
        librdkafka: The version that is loaded, which need not be that of confluent-kafka's wheel:
            a distribution links its own.
    """
    version = tuple(map(int, re.findall(r'\d+', librdkafka)[:2]))
    if is_classic(properties) or version >= _KIP_848_MENDED:
        return None
    return (
        f'needs librdkafka 2.15.0 or later, and {librdkafka} is loaded, whose members of such a '
        'group can stand still for minutes, and commit with stale epochs: upgrade '
        '(confluent-kafka 2.15 or later), or leave this line out (classic)'
    )


def _refused_alone(name: str, value: PropertyValue) -> str | None:
    """What librdkafka says of a property by itself, without making a client."""
    if (name, value) == (TOKEN_SOURCE, AWS):
        return None  # confluent-kafka wants others beside it
    # It looks at one after another, and would make a client if all of them had names.
    error = _client_error('producer', {name: value, _NO_NAME: ''})
    return None if error == _KNOWS_ALL_ELSE and name != _NO_NAME else error


def _together(properties: Mapping[str, PropertyValue], kinds: tuple[_Kind, ...]) -> dict[str, str]:
    """Problems of properties that are right one by one: files, and pairs that do not fit."""
    problems: dict[str, str] = {}
    # A client that asks for tokens does not survive a wrong file: librdkafka ends the process.
    if _lower(properties, _TOKEN_METHOD) == 'oidc' and (
        error := _client_error('producer', _offline(_tls_alone(properties)))
    ):
        return dict([_told(properties, error)])
    for kind in kinds:
        settings = (
            producer_properties(properties, client_id='check')
            if kind == 'producer'
            else consumer_properties(properties, group='check', client_id='check')
        )
        error = _client_error(kind, _offline(settings))
        if error is not None:
            users = {name: properties[name] for name in settings if name in properties}
            problems.setdefault(*_told(users, error))
    return problems


def _told(properties: Mapping[str, PropertyValue], error: str) -> tuple[str, str]:
    """The user's property that an error of a client speaks of, and what is wrong with it."""
    if refused := refused_file(error, properties):
        return refused
    name = _culprit(properties, error)
    return name, _sentence(name, properties.get(name, ''), error)


def _aws_problem(properties: Mapping[str, PropertyValue]) -> str | None:
    """What confluent-kafka would want before it asks AWS, which no client is made to find out."""
    if _lower(properties, TOKEN_SOURCE) != AWS:
        return None
    if properties[TOKEN_SOURCE] != AWS:
        return f'confluent-kafka knows one spelling of it: {AWS}'
    if properties.get(_TOKEN_METHOD) != 'oidc':  # other than librdkafka it knows one spelling
        return f'needs {_TOKEN_METHOD}: oidc'
    if not _lower(properties, _TOKEN_SETTINGS):
        return f'needs {_TOKEN_SETTINGS}, such as region=eu-central-1,audience=https://kafka'
    if find_spec('boto3') is None:
        return "needs boto3: pip install 'confluent-kafka[oauthbearer-aws]'"
    return None


def _lower(properties: Mapping[str, PropertyValue], name: str) -> str:
    return str(properties.get(name, '')).strip().lower()


def _offline(settings: Mapping[str, PropertyValue]) -> dict[str, PropertyValue]:
    """The same settings for a client that asks nobody, loads nothing and runs nothing."""
    left = {n: v for n, v in settings.items() if not runs_code(n, v)} | _NO_TICKETS
    left = {n: v for n, v in left.items() if canonical(n) != 'bootstrap.servers'}
    if 'ssl.providers' in settings:  # a key may be readable by one of them alone
        left = {n: v for n, v in left.items() if not n.startswith(_OF_PROVIDERS)}
    if _lower(settings, TOKEN_SOURCE) == AWS:  # without it the method would want an address
        left = {n: v for n, v in left.items() if n not in {TOKEN_SOURCE, _TOKEN_METHOD}}
    is_azure = _lower(left, TOKEN_SOURCE) == 'azure_imds'
    by_itself = is_azure and 'query' in _lower(left, _TOKEN_SETTINGS)
    if _TOKEN_URL in left or by_itself:
        left[_TOKEN_URL] = _NOWHERE
    return left


def _tls_alone(properties: Mapping[str, PropertyValue]) -> dict[str, PropertyValue]:
    tls = {n: v for n, v in properties.items() if n.startswith(('ssl.', 'https.', 'enable.ssl.'))}
    return {**tls, 'security.protocol': 'SSL'}


def _culprit(properties: Mapping[str, PropertyValue], error: str) -> str:
    """The user's property that an error speaks of, by its name or else by its value."""
    named = re.findall(r'[a-z_]+(?:\.[a-z_]+)+|acks|retries', error)
    for word in named:
        for name in properties:
            if canonical(name) == canonical(word):
                return name
    by_value = [n for n, v in properties.items() if len(str(v)) > 2 and str(v) in error]
    related = [n for n in properties for word in named if n.split('.')[0] == word.split('.')[0]]
    return next(iter([*by_value, *related, *properties]), 'bootstrap.servers')


def _sentence(name: str, value: PropertyValue, error: str) -> str:
    if error.startswith('No such configuration property'):
        near = difflib.get_close_matches(name, KNOWN, 1, 0.75)
        meant = f" (did you mean '{near[0]}'?)" if near else ''
        return f'librdkafka knows no such property{meant}'
    if is_secret(name) and (str(value) in error or not _CREATION.match(error)):
        return 'librdkafka refuses its value'
    text = _CREATION.sub('', error).strip()
    return f'librdkafka refuses it: {text[:1].lower() + text[1:]}'


def _client_error(kind: _Kind, settings: Mapping[str, PropertyValue]) -> str | None:
    """What librdkafka says of a client with these settings, None where it makes one."""
    from confluent_kafka import Consumer, KafkaException, Producer  # noqa: PLC0415  # slow

    wanted: dict[str, Any] = dict(settings)
    try:
        if kind == 'producer':
            Producer(wanted, logger=_silent_logger()).flush(0)
        else:
            Consumer(wanted, logger=_silent_logger()).close()
    except KafkaException as error:
        return str(error.args[0].str())
    except (TypeError, ValueError) as error:
        return str(error)
    return None


def _silent_logger() -> logging.Logger:
    """A logger of nobody: what a client without a broker complains of interests nobody."""
    logger = logging.Logger('ros2_kafka_bridge.kafka.properties')  # noqa: LOG001
    logger.addHandler(logging.NullHandler())
    return logger
