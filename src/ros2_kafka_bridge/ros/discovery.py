"""Why the ROS graph may show only a part of those who are there, by how Fast DDS finds others.

Only what is certain is said; of other middlewares, and of what is not known here, nothing.
"""

import os
from collections.abc import Mapping
from typing import Final, NamedTuple

from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.ros.fastdds_profile import discovery_protocol, user_profile
from ros2_kafka_bridge.ros.node import is_fastdds

ANNOUNCED_S: Final = 4.0
"""In which whoever is there is seen: Fast DDS announces a participant every 3 s."""

_SERVER: Final = 'ROS_DISCOVERY_SERVER'
_RANGE: Final = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
_YES: Final = frozenset({'TRUE', 'true', 'True', '1'})  # as Fast DDS spells it
_PART: Final = (
    'a discovery server tells this process only of topics on which it has a publisher or '
    'subscriber itself'
)

NOT_TOLD: Final = 'a discovery server does not tell this process who is there'
"""What is said of a topic with a `partial_view`, which stands elsewhere with the cure."""


class _Way(NamedTuple):
    """How Fast DDS finds others, by its own name for it, and where that is said.

    Args:
        protocol: NONE finds nobody, OFF is ROS's own word for it; empty where it is not certain.
    """

    protocol: str
    place: str = ''


def partial_view(environ: Mapping[str, str] | None = None) -> str | None:
    """Why the graph shows only a part, and the cure; None where it shows all, or may."""
    protocol, place = _way(os.environ if environ is None else environ)
    if protocol != 'CLIENT':
        return None
    if place == _SERVER:
        return f'{_PART} ({place}): set ROS_SUPER_CLIENT=TRUE to be told of all'
    return f'{_PART}: write SUPER_CLIENT instead of CLIENT in {place} to be told of all'


def why_nobody(environ: Mapping[str, str] | None = None) -> str | None:
    """Why nobody at all is seen, as far as the environment says; None where it does not."""
    environ = os.environ if environ is None else environ
    protocol, place = _way(environ)
    match protocol:
        case 'SIMPLE':
            return _out_of_reach(environ)
        case 'SUPER_CLIENT':
            return f'only a discovery server tells of others ({place}): does it run, is it theirs?'
        case 'OFF':
            return f'no other node is seen, nor is a discovery server asked ({place} is OFF)'
        case 'NONE' if place == _SERVER:
            return f'{place} names no server, and so Fast DDS finds nobody: name one, or unset it'
        case 'NONE':
            return f'Fast DDS finds nobody with the discoveryProtocol NONE of {place}'
        case _:
            partial = partial_view(environ)
            return f'{partial}; does the server run, is its address right?' if partial else None


WHERE_IS_IT: Final = (
    'do the nodes run, with the same ROS_DOMAIN_ID; on another machine, does '
    'ROS_AUTOMATIC_DISCOVERY_RANGE let them be seen?'
)
"""What to ask who sees no node, of any domain."""


def hint(question: str = WHERE_IS_IT) -> str:
    """What to look for where nobody is seen."""
    why = why_nobody()
    if why is None:
        return question
    return why if partial_view() else f'{why}; {question}'


def waits_for_type(topic: str) -> str:
    """What a route says that is to learn its type, while nobody is seen to publish."""
    said = f'waits for a publisher of {topic} to learn its type from (from.type is not set)'
    return _while_unseen(said, 'write from.type')


def waits_for_description(topic: str, problem: str) -> str:
    """What a route says of a type that is not known here, while nobody is seen to use it.

    Args:
        topic: The ROS topic.
        problem: That it is not known, in words.
    """
    said = f'waits for a node that uses {topic}, to ask it for the type: {problem}'
    return _while_unseen(said, 'put its .msg files into a folder of ros.message_path')


def _while_unseen(said: str, cure: str) -> str:
    if why := partial_view():
        return f'{said}: {why}, or {cure}'
    why = why_nobody()
    return f'{said}; {why}' if why else said


def _out_of_reach(environ: Mapping[str, str]) -> str | None:
    """Which nodes are not found without a server."""
    reach = environ.get(_RANGE)
    if environ.get('ROS_LOCALHOST_ONLY') == '1':
        return 'nodes of other machines are not seen (ROS_LOCALHOST_ONLY)'
    if reach == 'LOCALHOST' and not environ.get('ROS_STATIC_PEERS'):
        return f'nodes of other machines are not seen ({_RANGE} is LOCALHOST)'
    return None


def _way(environ: Mapping[str, str]) -> _Way:
    if not is_fastdds():
        return _Way('')
    if environ.get(_RANGE) == 'OFF':  # counts before all others, the DDS profile too
        return _Way('OFF', _RANGE)
    # What a file says that this one names counts before the environment.
    if environ.get('FASTDDS_ENVIRONMENT_FILE'):
        return _Way('')
    file = user_profile(environ)
    try:
        protocol = 'SIMPLE' if file is None else discovery_protocol(file)
    except ConfigError:  # which is said where a node is opened
        return _Way('')
    # With any other one the environment counts for nothing.
    return _way_of_environ(environ) if protocol == 'SIMPLE' else _Way(protocol, str(file))


def _way_of_environ(environ: Mapping[str, str]) -> _Way:
    if environ.get('ROS2_EASY_MODE'):  # a super client, but Fast DDS 2 does not know of it
        return _Way('')
    servers = environ.get(_SERVER, '')
    if not servers:
        return _Way('SIMPLE')
    if not servers.strip(';'):
        return _Way('NONE', _SERVER)
    return _Way('SUPER_CLIENT' if environ.get('ROS_SUPER_CLIENT') in _YES else 'CLIENT', _SERVER)
