"""The floor of the simulated warehouse: what stands where, and who may drive in one step."""

from collections.abc import Container, Mapping
from typing import Final

import msgspec

from ros2_kafka_warehouse.domain.site import Site
from ros2_kafka_warehouse.messages.message import Cell
from ros2_kafka_warehouse.messages.robots import Load

_REMEMBERED: Final = 200  # loads that were delivered; far more than can be asked for again


class _Kept(msgspec.Struct, omit_defaults=True):
    """What the floor writes into `FleetState.floor`, and reads from there."""

    pallets: list[tuple[Cell, str]] = []
    waiting: list[Cell] = []
    loads: list[tuple[Cell, Load]] = []
    issued: list[str] = []
    delivered: list[str] = []
    chargers: list[tuple[Cell, str]] = []


class Floor:
    """Pallets, loads that stand on the floor, and which loads have left the stock.

    Attributes:
        pallets: Cells that are blocked, with the robot whose fault it is, or ''.
        waiting: Cells where a pallet is put as soon as no robot holds them.
        loads: Loads on the floor; robots drive over them.
        chargers: Dead chargers, with the robot whose fault it is.
    """

    def __init__(self, site: Site) -> None:
        self.free = frozenset(
            (column, row)
            for row, text in enumerate(site.rows)
            for column, mark in enumerate(text)
            if mark != '@'
        )
        self.pallets: dict[Cell, str] = {}
        self.waiting: dict[Cell, None] = {}
        self.loads: dict[str, tuple[Cell, Load]] = {}
        self.chargers: dict[Cell, str] = {}
        self._issued: dict[str, None] = {}
        self._delivered: dict[str, None] = {}
        self._stock = {name: frozenset(item.cells) for name, item in site.products.items()}
        self._stations = frozenset(site.stations.values())

    def is_open(self, cell: Cell) -> bool:
        """Whether a robot can drive on a cell, if no other is there."""
        return cell in self.free and cell not in self.pallets

    def is_issued(self, load_id: str) -> bool:
        """Whether a load has left the stock; it does so once."""
        return load_id in self._issued or load_id in self._delivered

    def issue(self, load_id: str, product: str, cell: Cell) -> bool:
        """Takes a load from stock; False if it is not there (any more)."""
        if self.is_issued(load_id) or cell not in self._stock.get(product, ()):
            return False
        self._issued[load_id] = None
        return True

    def put(self, load: Load, cell: Cell, *, to_station: bool = True) -> None:
        """Puts a load down: at a station it is delivered, elsewhere it stands on the floor."""
        if not (to_station and cell in self._stations):
            self.loads[load.load_id] = (cell, load)
            return
        self._issued.pop(load.load_id, None)
        self._delivered[load.load_id] = None
        if len(self._delivered) > _REMEMBERED:
            del self._delivered[next(iter(self._delivered))]

    def repair(self, robot: str) -> None:
        """Takes away the pallets and mends the chargers that a robot's faults stand for."""
        self.pallets = {cell: name for cell, name in self.pallets.items() if name != robot}
        self.chargers = {cell: name for cell, name in self.chargers.items() if name != robot}

    def text(self) -> str:
        """All of it as JSON; '' if there is nothing."""
        kept = _Kept(
            pallets=list(self.pallets.items()),
            waiting=list(self.waiting),
            loads=list(self.loads.values()),
            issued=list(self._issued),
            delivered=list(self._delivered),
            chargers=list(self.chargers.items()),
        )
        return '' if kept == _Kept() else msgspec.json.encode(kept).decode()

    def read(self, text: str) -> None:
        """The floor of such a text."""
        kept = msgspec.json.decode(text, type=_Kept) if text else _Kept()
        self.pallets = dict(kept.pallets)
        self.waiting = dict.fromkeys(kept.waiting)
        self.loads = {load.load_id: (cell, load) for cell, load in kept.loads}
        self._issued = dict.fromkeys(kept.issued)
        self._delivered = dict.fromkeys(kept.delivered)
        self.chargers = dict(kept.chargers)


def is_next(one: Cell, other: Cell) -> bool:
    """Whether two cells share an edge."""
    return abs(one[0] - other[0]) + abs(one[1] - other[1]) == 1


def granted(
    wishes: Mapping[Cell, Cell], swift: Container[Cell], held: Container[Cell]
) -> set[Cell]:
    """Which robots get on their way: nobody meets another, whatever was wished.

    A robot may follow one that leaves in the same step if both need one step; so trains and full
    circles move together. Two that change places do not.

    Args:
        wishes: Where each robot (named by the cell on which it stands) wants to go.
        swift: Those robots that need one step to the next cell.
        held: All cells that any robot holds.
    """
    claims: dict[Cell, Cell] = {}
    verdicts: dict[Cell, bool] = {}
    for cell, target in wishes.items():
        if claims.setdefault(target, cell) != cell:
            verdicts[cell] = False
    for start in wishes:
        chain: list[Cell] = []
        cell = start
        while (verdict := verdicts.get(cell)) is None:
            chain.append(cell)
            target = wishes[cell]
            if target not in held:
                verdict = True
            elif (
                target not in wishes
                or cell not in swift
                or target not in swift
                or wishes[target] == cell
            ):
                verdict = False
            elif target == start:
                verdict = True
            if verdict is not None:
                break
            cell = target
        for link in chain:
            verdicts[link] = verdict
    return {cell for cell, verdict in verdicts.items() if verdict}
