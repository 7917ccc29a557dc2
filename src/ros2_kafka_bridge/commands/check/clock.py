"""What `check` says of the time of day, where it cannot be right."""

from collections.abc import Iterator

from ros2_kafka_bridge.commands.screen import Finding
from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.route import clock


def clock_findings(config: Config) -> Iterator[Finding]:
    """What a wrong clock does to the bridge as a whole."""
    problem = clock.problem()
    if not problem:
        return
    if names := ', '.join(route.name for route in config.routes if route.max_age_s is not None):
        yield Finding('bad', 'clock', f'routes with max_age_s ({names}) wait: {problem}')
        return
    text = (
        'records and dead letters are written with a time long past, and retention may delete '
        f'them at once: {problem}'
    )
    yield Finding('note', 'clock', text)


def age_findings(route: AnyRoute) -> Iterator[Finding]:
    """What it does to a route."""
    if route.max_age_s is not None and clock.problem():
        text = 'the route waits until the clock of this machine is set (max_age_s)'
        yield Finding('note', 'clock', text, waits='for the clock of this machine')
