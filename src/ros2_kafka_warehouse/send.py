"""Orders and commands from the command line, to Kafka."""

import threading
import time
import uuid
from collections.abc import Iterable, Iterator
from pathlib import Path
from random import Random

from ros2_kafka_warehouse.codec import MessageError, decode, encode
from ros2_kafka_warehouse.domain.execution_profiles import read_execution_profiles
from ros2_kafka_warehouse.domain.random_orders import random_order
from ros2_kafka_warehouse.domain.site import Site
from ros2_kafka_warehouse.kafka import Sender
from ros2_kafka_warehouse.messages.monitor import OperatorCommand
from ros2_kafka_warehouse.messages.orders import OrderRequest

_ORDERS = 'warehouse.orders'
_COMMANDS = 'warehouse.commands'
_COMMAND_S = 5.0  # a person waits for it


class RequestError(ValueError):
    """A file that holds something else than orders; says which line and what is wrong."""


def read_requests(path: Path) -> Iterator[OrderRequest]:
    """The orders of a file with one in JSON on each line.

    Raises:
        RequestError: The file cannot be read, or a line is no order.
    """
    try:
        lines = path.read_text(encoding='utf-8').splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise RequestError(f'{path}: cannot be read: {error}') from error
    for number, line in enumerate(lines, 1):
        if line.strip():
            try:
                yield decode(line, OrderRequest)
            except MessageError as error:
                raise RequestError(f'{path}, line {number}: {error}') from error


def random_requests(site: Site, random: Random) -> Iterator[OrderRequest]:
    """Random orders of a site without end, with names that nobody else uses."""
    stem = uuid.uuid4().hex[:12]
    profiles = read_execution_profiles()
    number = 0
    while True:
        number += 1
        yield random_order(site, random, f'R-{stem}-{number}', time.time(), profiles)


def send_requests(bootstrap_servers: str, requests: Iterable[OrderRequest]) -> int:
    """Send orders; returns how many, once Kafka has them all.

    Raises:
        AwayError: Kafka has not taken all of them.
    """
    count = 0
    with Sender(bootstrap_servers) as sender:
        for request in requests:
            sender.send(_ORDERS, request.order_id, encode(request))
            count += 1
    return count


def send_random(
    bootstrap_servers: str, site: Site, random: Random, pause_s: float, ended: threading.Event
) -> None:
    """Send random orders with a pause after each, until the end."""
    sender = Sender(bootstrap_servers)
    for request in random_requests(site, random):
        if ended.wait(pause_s):
            return
        sender.send(_ORDERS, request.order_id, encode(request))


def send_command(bootstrap_servers: str, command: OperatorCommand) -> None:
    """Send a command.

    Raises:
        AwayError: Kafka has not taken it.
    """
    sender = Sender(bootstrap_servers)
    sender.send(_COMMANDS, 'operator', encode(command))
    sender.flush(_COMMAND_S)
