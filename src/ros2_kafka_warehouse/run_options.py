"""What the user asks `ros2-kafka-warehouse run` for, and whether it can be: looked at first."""

import socket
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from ros2_kafka_warehouse.domain.execution_profiles import read_execution_profiles
from ros2_kafka_warehouse.domain.faults import read_fault
from ros2_kafka_warehouse.domain.robot_failure_profile import read_failure_profile
from ros2_kafka_warehouse.domain.site import Site, check_robot_types, choose_site

_DATA: Final = Path(__file__).parent / 'data'


class StartError(Exception):
    """What this machine has no room for: says what is in the way, and what to do."""


class Options(NamedTuple):
    """What the user asks for.

    Attributes:
        site: The site file; None for the site of the package, or one made for `robots`.
        robots: How many robots a site is made for.
        step_s: Seconds of a step, if not those of the site.
        bootstrap_servers: Of a real Kafka; None for the embedded broker.
        domain: ROS domain; None for that of the environment.
        orders_per_minute: Random orders that are sent.
        host: Where the page listens.
        port: Of the page; 0 for no page.
        seed: Of the made site, the random orders and the robots' random faults.
        logs: Where the logs go, and stay; None for a place that goes with the warehouse.
        profiles: The file of the execution profiles.
        failure_profile: The file of the robot failure profile.
        failures_per_hour: Faults that the robots show by chance, all together.
        without: Modules that are not started, because the user runs nodes of their own.
        allow_hosts: Names under which browsers reach the page, beside that of `host`.
        faults: Those that robots show for sure, each as `ROBOT:CODE@STEP`.
    """

    site: Path | None = None
    robots: int | None = None
    step_s: float | None = None
    bootstrap_servers: str | None = None
    domain: int | None = None
    orders_per_minute: float = 0.0
    host: str = '127.0.0.1'
    port: int = 8080
    seed: int = 0
    logs: Path | None = None
    profiles: Path = _DATA / 'execution_profiles.yaml'
    failure_profile: Path = _DATA / 'robot_failure_profile.yaml'
    failures_per_hour: float = 0.0
    without: tuple[str, ...] = ()
    allow_hosts: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()


def site_of(options: Options) -> Site:
    """The site that is asked for.

    Raises:
        SiteError: The site cannot be.
    """
    site = choose_site(options.site, options.robots, options.seed)
    if options.step_s is not None:
        site = msgspec.structs.replace(site, step_s=options.step_s)
    return site


def check(options: Options, site: Site) -> None:
    """Find what cannot go well before anything is started.

    Raises:
        FaultError: A fault cannot be.
        SiteError: A robot is of a type that nobody knows.
        ProfileError: A profile cannot be read.
        StartError: The page cannot listen there.
    """
    for text in options.faults:
        read_fault(text, site.robots)
    if 'execution_profiles' not in options.without:
        types = read_execution_profiles(options.profiles).robot_types
        check_robot_types(site, list(types), options.site)
    if 'robot_failure_profile' not in options.without:
        read_failure_profile(options.failure_profile)
    if options.port:
        _check_address(options.host, options.port)


def _check_address(host: str, port: int) -> None:
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        with socket.socket(family, socket.SOCK_STREAM) as tried:
            tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the page does
            tried.bind((host, port))
            tried.listen()
    except socket.gaierror as error:
        raise StartError(
            f'--host {host}: {error.strerror}: name an address of this machine'
        ) from None
    except OSError as error:
        raise StartError(
            f'the page cannot listen on {host}, port {port}: {error.strerror}: '
            'choose another --port (0: no page) or --host'
        ) from None
