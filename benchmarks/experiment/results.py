"""What is measured: value types, and the files that they are kept in.

A directory of results has one file for each cell, so that a run that was interrupted goes on where
it was, and `experiment.json` with what is true of all of them.
"""

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Final, TypeVar

import msgspec

T = TypeVar('T')

EXPERIMENT_FILE: Final = 'experiment.json'
SETTING_FILE: Final = 'setting.json'
CELLS: Final = 'cells'
STARTS: Final = 'starts'


class Load(msgspec.Struct, frozen=True):
    """How orders are sent.

    Args:
        name: Unique, short: `9.6`, `1000`, `max`, `bursts`.
        words: For a reader: `9.6 orders/s`, `as fast as possible`.
        rate: Orders per second, 0 for as fast as possible; of bursts, those in the mean.
        burst: Orders that are sent at once; 1 where they are sent evenly.
        of_paper: Whether the paper ran it.
    """

    name: str
    words: str
    rate: float
    burst: int = 1
    of_paper: bool = False


class Cell(msgspec.Struct, frozen=True):
    """One measurement.

    Args:
        contestant: `paper`, `bridge`, `keep_last` (the bridge with KEEP_LAST), `bare` or
            `recording`.
        depth: Of KEEP_LAST at both ends; None where the contestant has none.
        seconds: How long orders are sent, at most.
    """

    contestant: str
    depth: int | None
    load: Load
    seconds: float

    @property
    def key(self) -> str:
        """Names the cell, and its file."""
        depth = '' if self.depth is None else f'-{self.depth}'
        return f'{self.load.name}-{self.contestant}{depth}'


class Counts(msgspec.Struct, frozen=True):
    """Orders at each of the four places, as the paper counts them, and what is wrong with them.

    Args:
        producer: Taken by Kafka.
        kafka_ros: Published to ROS by the kafka-ros bridge.
        ros_kafka: Produced to Kafka by the ros-kafka bridge.
        consumer: Different ones that came to the consumer.
        duplicated: Came to the consumer more than once.
        out_of_order: Came after one with a higher number.
    """

    producer: int
    kafka_ros: int
    ros_kafka: int
    consumer: int
    duplicated: int
    out_of_order: int

    @property
    def lost(self) -> int:
        """Orders that never came."""
        return self.producer - self.consumer

    @property
    def loss(self) -> float:
        """Share of the orders that never came, 0 to 1."""
        return self.lost / self.producer if self.producer else 0.0


class Latency(msgspec.Struct, frozen=True):
    """From the producer's stamp to the consumer, in milliseconds, of the orders that came.

    Args:
        first: Of the order that came first.
        curve: Latency at the shares in `SHARES`, for plots.
    """

    first: float
    fastest: float
    median: float
    p95: float
    p99: float
    p999: float
    slowest: float
    curve: Sequence[float]


SHARES: Final = (*(i / 200 for i in range(200)), 0.999, 0.9999, 1.0)
"""Shares of the orders at which `Latency.curve` is taken."""


class Usage(msgspec.Struct, frozen=True):
    """What a process has used.

    Args:
        before_mib: Anonymous memory before the first order.
        peak_mib: The most from then on.
        cpu_s: CPU seconds from the first order on.
        seconds: Times of `memory_mib`, from the first order on.
        memory_mib: Anonymous memory at these times.
    """

    before_mib: float
    peak_mib: float
    cpu_s: float
    seconds: Sequence[float] = ()
    memory_mib: Sequence[float] = ()


class Hops(msgspec.Struct, frozen=True):
    """Median milliseconds of each hop, where the records tell it (the bridge's headers do).

    Args:
        to_ros: From the producer's stamp to the publishing in ROS.
        to_kafka: From there to the broker's timestamp (1 ms fine).
        to_consumer: From there to the consumer.
    """

    to_ros: float
    to_kafka: float
    to_consumer: float


class Result(msgspec.Struct, frozen=True):
    """What was measured in a cell.

    Args:
        at: When, ISO 8601.
        sent_per_s: Orders per second that were really sent.
        delivered_per_s: Orders per second that came, from the first to the last.
        latency: None where nothing came.
        hops: None where the records do not tell.
        problems: What went wrong with the measuring itself.
    """

    cell: Cell
    at: str
    counts: Counts
    sent_per_s: float
    delivered_per_s: float
    latency: Latency | None
    kafka_ros: Usage
    ros_kafka: Usage
    broker: Usage
    hops: Hops | None = None
    problems: Sequence[str] = ()

    @property
    def cpu_ms_per_order(self) -> float:
        """CPU milliseconds of both bridges for an order that came (seconds per thousand)."""
        return 1000 * (self.kafka_ros.cpu_s + self.ros_kafka.cpu_s) / max(1, self.counts.consumer)

    @property
    def broker_share(self) -> float:
        """The broker's share of the CPU time of broker and bridges, 0 to 1."""
        bridges = self.kafka_ros.cpu_s + self.ros_kafka.cpu_s
        return self.broker.cpu_s / max(self.broker.cpu_s + bridges, 1e-9)


class StartUp(msgspec.Struct, frozen=True):
    """How long an order that waits in Kafka takes from the start of both bridges on.

    Args:
        seconds: Of each start.
    """

    contestant: str
    depth: int | None
    seconds: Sequence[float]


class Prediction(msgspec.Struct, frozen=True):
    """The loss that `ros2-kafka-bridge depth` expects, and the one measured.

    It knows a recording of the same load by a reader that loses nothing, not the cell itself.

    Args:
        loss: Predicted share of messages, 0 to 1, between `low` and `high` with 95 %.
        seen: Whether the recording had such a backlog; else the tail is estimated.
        measured: Share lost between the two bridges.
        messages: Of which it is the share.
    """

    load: Load
    depth: int
    loss: float
    low: float
    high: float
    seen: bool
    measured: float
    messages: int = 0


class Setting(msgspec.Struct, frozen=True):
    """What is true of all cells.

    Args:
        command: That repeats it.
        machine: `cpu`, `cores`, `memory_gib`, and what else there is.
        versions: Of the parts, by name.
        kafka: `local` or the bootstrap servers.
        most_orders: Of a cell, however fast they are sent.
    """

    command: str
    started: str
    seconds: float
    machine: dict[str, str | int | float]
    versions: dict[str, str]
    kafka: str
    seed: int
    most_orders: int = 100_000


class Experiment(msgspec.Struct, frozen=True):
    """All that the report is made of."""

    setting: Setting
    results: Sequence[Result]
    predictions: Sequence[Prediction] = ()
    starts: Sequence[StartUp] = ()


def keep(place: Path, result: Result) -> None:
    """Write a cell's result, whole or not at all."""
    _write(place / CELLS / f'{result.cell.key}.json', msgspec.json.encode(result))


def kept(place: Path, cell: Cell) -> Result | None:
    """Read the result of a cell; None where there is none, or one of another length."""
    result = _read(place / CELLS / f'{cell.key}.json', Result)
    return result if result and result.cell == cell else None


def keep_start(place: Path, start: StartUp) -> None:
    """Write how long a contestant takes to start."""
    _write(_start_file(place, start.contestant, start.depth), msgspec.json.encode(start))


def kept_start(place: Path, contestant: str, depth: int | None) -> StartUp | None:
    """Read how long a contestant takes to start; None where that was not measured."""
    return _read(_start_file(place, contestant, depth), StartUp)


def _start_file(place: Path, contestant: str, depth: int | None) -> Path:
    return (
        place / STARTS / (f'{contestant}.json' if depth is None else f'{contestant}-{depth}.json')
    )


def keep_setting(place: Path, setting: Setting) -> None:
    """Write what the cells of a directory are measured with."""
    _write(place / SETTING_FILE, msgspec.json.encode(setting))


def setting(place: Path) -> Setting | None:
    """Read what the cells of a directory are measured with; None where there are none."""
    return _read(place / SETTING_FILE, Setting)


def forget(place: Path) -> None:
    """Delete what was measured in a directory."""
    for name in (CELLS, STARTS):
        shutil.rmtree(place / name, ignore_errors=True)


def write(place: Path, experiment: Experiment) -> None:
    """Write all of it into one file."""
    _write(place / EXPERIMENT_FILE, msgspec.json.format(msgspec.json.encode(experiment)))


def read(file: Path) -> Experiment:
    """Read what `write` has written.

    Raises:
        msgspec.DecodeError: It is none.
        OSError: It cannot be read.
    """
    return msgspec.json.decode(file.read_bytes(), type=Experiment)


def _read(file: Path, type_: type[T]) -> T | None:
    try:
        return msgspec.json.decode(file.read_bytes(), type=type_)
    except (FileNotFoundError, msgspec.DecodeError):
        return None


def _write(file: Path, data: bytes) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    new = file.with_suffix('.new')
    new.write_bytes(data)
    new.rename(file)
