"""Random warehouse orders, as the demo, the benchmarks and the warehouse send them.

An order names 1 to 7 products, each with its dimensions, weight, material and place. Encoded as
JSON it takes 180 to 940 bytes, 550 in the mean.
"""

import random
import time
from collections.abc import Callable, Iterator
from typing import Final, Literal, get_args

import msgspec

from ros2_kafka_bridge.errors import DecodeError

__all__ = [
    'MATERIALS',
    'Coordinates',
    'Dimensions',
    'Material',
    'Order',
    'Product',
    'decode',
    'encode',
    'orders',
]

Material = Literal['cardboard', 'fabric', 'glass', 'metal', 'paper', 'plastic', 'rubber', 'wood']
"""What a product is made of."""

MATERIALS: Final[tuple[Material, ...]] = get_args(Material)
"""All of them; each is as likely as the others."""

MOST_PRODUCTS: Final = 7


class Dimensions(msgspec.Struct, frozen=True, gc=False):
    """The size of a product, in centimetres."""

    height: int
    width: int
    length: int


class Coordinates(msgspec.Struct, frozen=True, gc=False):
    """The place of a product: a cell of the warehouse's grid (x, y) and the shelf above it (z)."""

    x: int
    y: int
    z: int


class Product(msgspec.Struct, frozen=True, gc=False):
    """One thing to fetch.

    Args:
        weight: In kilograms.
    """

    dimensions: Dimensions
    weight: float
    material: Material
    coordinates: Coordinates


class Order(msgspec.Struct, frozen=True, gc=False):
    """What a customer wants to have fetched.

    Args:
        order_id: Counts from 0 within one seed.
        created_ns: When the order was made, in nanoseconds since 1970.
        products: 1 to 7 of them.
    """

    order_id: int
    created_ns: int
    products: tuple[Product, ...]


def orders(seed: int, *, clock: Callable[[], int] = time.time_ns) -> Iterator[Order]:
    """Make orders without end.

    Args:
        seed: Equal seeds make equal orders, but for the time.
        clock: Gives `created_ns`; one that is fixed makes the orders equal to the last byte.
    """
    rng = random.Random(seed)  # noqa: S311 - goods are no secret
    order_id = 0
    while True:
        count = 1 + int(rng.random() * MOST_PRODUCTS)
        yield Order(order_id, clock(), tuple(_product(rng.random) for _ in range(count)))
        order_id += 1


def encode(order: Order) -> bytes:
    """Write an order as JSON in UTF-8."""
    return _ENCODER.encode(order)


def decode(value: bytes) -> Order:
    """Read an order.

    Raises:
        DecodeError: The value is no order.
    """
    try:
        return _DECODER.decode(value)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise DecodeError(f'no order: {error}') from error


def _product(share: Callable[[], float]) -> Product:
    return Product(
        Dimensions(1 + int(80 * share()), 1 + int(80 * share()), 1 + int(120 * share())),
        round(0.05 + 30 * share(), 2),
        MATERIALS[int(len(MATERIALS) * share())],
        Coordinates(int(80 * share()), int(50 * share()), int(6 * share())),
    )


_ENCODER: Final = msgspec.json.Encoder()
_DECODER: Final = msgspec.json.Decoder(Order)
