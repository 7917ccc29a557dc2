"""The command line of `dead-letters`: text -> configuration and query; no logic."""

import enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ros2_kafka_bridge.commands.options import AsJson
from ros2_kafka_bridge.errors import ConfigError

if TYPE_CHECKING:
    from ros2_kafka_bridge.commands.dead_letters.report import LetterQuery

app = typer.Typer(
    help='Look at dead letters, and send them again once their cause is mended.',
    no_args_is_help=True,
)


class Target(enum.StrEnum):
    """Where letters are replayed to."""

    KAFKA = 'kafka'
    ROS = 'ros'


LettersFile = Annotated[
    Path,
    typer.Argument(help='Configuration (YAML): brokers and routes.', show_default=False),
]
RouteOption = Annotated[str, typer.Option(metavar='NAME', help='Letters of this route.')]
Reason = Annotated[
    str,
    typer.Option(metavar='TEXT', help='Reasons that hold this text or regular expression.'),
]
Since = Annotated[
    str,
    typer.Option(metavar='TIME', help='Not older: 2026-01-31T08:00, or an age as 90s, 2h, 7d.'),
]
Until = Annotated[str, typer.Option(metavar='TIME', help='Older than that.')]
PartitionOption = Annotated[
    int | None, typer.Option(min=0, metavar='N', help='Of the dead-letter topic.')
]
Offset = Annotated[int | None, typer.Option(min=0, metavar='N', help='In that partition.')]
Limit = Annotated[
    int | None, typer.Option(min=1, metavar='N', help='At most so many, the oldest first.')
]
TopicOption = Annotated[
    str,
    typer.Option(metavar='TOPIC', help='Dead-letter topic.  [default: those of the routes]'),
]


@app.command('list')
def list_(
    file: LettersFile,
    *,
    route: RouteOption = '',
    reason: Reason = '',
    since: Since = '',
    until: Until = '',
    partition: PartitionOption = None,
    offset: Offset = None,
    limit: Limit = None,
    topic: TopicOption = '',
    as_json: AsJson = False,
) -> None:
    """A line for each letter, and how many there are of each route and reason.

    Exit status: 0 looked, 1 Kafka was away or refused, 2 the file or an option is wrong.
    """
    query = _query(file, topic, route, reason, since, until, partition, offset, limit)

    from ros2_kafka_bridge.commands.dead_letters.report import list_letters, spoken  # noqa: PLC0415 (heavy)

    raise typer.Exit(spoken(lambda: list_letters(query, as_json=as_json)))


@app.command()
def show(
    file: LettersFile,
    letter: Annotated[
        str,
        typer.Argument(
            metavar='[TOPIC[P]@OFFSET]', help='One letter, as list prints it.', show_default=False
        ),
    ] = '',
    *,
    route: RouteOption = '',
    reason: Reason = '',
    since: Since = '',
    until: Until = '',
    partition: PartitionOption = None,
    offset: Offset = None,
    limit: Limit = None,
    topic: TopicOption = '',
    raw: Annotated[
        bool, typer.Option('--raw', help='The bytes of the value, nothing else.')
    ] = False,
) -> None:
    """Everything of a letter: why, its headers, its value.

    Exit status: 0 shown, 1 Kafka was away or refused, or a transaction that has not ended hides
    what may be such a letter, 2 the file or an option is wrong, or there is no such letter.
    """
    if letter:
        topic, partition, offset = _place(letter, topic, partition, offset)
    query = _query(file, topic, route, reason, since, until, partition, offset, limit)

    from ros2_kafka_bridge.commands.dead_letters.report import show_letters, spoken  # noqa: PLC0415 (heavy)

    raise typer.Exit(spoken(lambda: show_letters(query, raw=raw)))


@app.command()
def replay(
    file: LettersFile,
    *,
    to: Annotated[
        Target, typer.Option(help='The topic that they were on their way to or from, or ROS.')
    ] = Target.KAFKA,
    route: RouteOption = '',
    reason: Reason = '',
    since: Since = '',
    until: Until = '',
    partition: PartitionOption = None,
    offset: Offset = None,
    limit: Limit = None,
    topic: TopicOption = '',
    every: Annotated[bool, typer.Option('--all', help='No filter is meant.')] = False,
    dry_run: Annotated[
        bool, typer.Option('--dry-run', help='Say what would be done, and do nothing.')
    ] = False,
    again: Annotated[bool, typer.Option('--again', help='Also what was replayed before.')] = False,
    force: Annotated[
        bool,
        typer.Option('--force', help='Back to its Kafka topic also what would fail again.'),
    ] = False,
) -> None:
    """Send letters again; what would fail again is left.

    To Kafka each is written exactly once (brokers of Kafka 3.6.1 or later), however the replay
    ends, and however often it is begun; to ROS at least once. docs/dead-letters.md explains it.

    Exit status: 0 done, 1 some were left or Kafka or ROS was away (the same command goes on with
    the rest), 2 the file or an option is wrong, or there is no such letter.
    """
    query = _query(file, topic, route, reason, since, until, partition, offset, limit)

    from ros2_kafka_bridge.commands.dead_letters import replay as command  # noqa: PLC0415 (heavy)
    from ros2_kafka_bridge.commands.dead_letters.report import spoken  # noqa: PLC0415

    options = command.ReplayOptions(
        to_ros=to is Target.ROS, dry_run=dry_run, again=again, force=force, all=every
    )
    raise typer.Exit(spoken(lambda: command.replay(query, options)))


def _place(
    text: str, topic: str, partition: int | None, offset: int | None
) -> tuple[str, int, int]:
    from ros2_kafka_bridge.dead_letters.letter import LetterPlace  # noqa: PLC0415

    place = LetterPlace.parse(text)
    if place is None:
        raise ConfigError([f'{text!r} is no letter: one is written as orders.dead-letters[0]@5'])
    given = zip((topic or None, partition, offset), place, strict=True)
    if any(one not in {None, own} for one, own in given):
        raise ConfigError([f'{text} and --topic, --partition or --offset name two letters'])
    return place


def _query(
    file: Path,
    topic: str,
    route: str,
    reason: str,
    since: str,
    until: str,
    partition: int | None,
    offset: int | None,
    limit: int | None,
) -> 'LetterQuery':
    from datetime import UTC, datetime  # noqa: PLC0415 (--help must be quick)

    from ros2_kafka_bridge.dead_letters.filter import LetterFilter, time_ms  # noqa: PLC0415
    from ros2_kafka_bridge.process.load import load_checked  # noqa: PLC0415
    from ros2_kafka_bridge.route import clock  # noqa: PLC0415

    if (since or until) and (problem := clock.problem()):
        raise ConfigError([f'{"--since" if since else "--until"}: {problem}'])
    now = datetime.now(UTC)
    letter_filter = LetterFilter(
        route=route,
        reason=reason,
        since_ms=time_ms(since, '--since', now),
        until_ms=time_ms(until, '--until', now),
        partition=partition,
        offset=offset,
        limit=limit,
    )
    config = load_checked(file)

    from ros2_kafka_bridge.commands.dead_letters.report import LetterQuery  # noqa: PLC0415 (heavy)

    return LetterQuery(config, topic, letter_filter)
