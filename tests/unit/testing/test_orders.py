"""The random orders: as the paper says, from their seed alone, there and back as JSON."""

import json
from collections import Counter
from itertools import islice
from statistics import mean

import pytest

from ros2_kafka_bridge.errors import DecodeError
from ros2_kafka_bridge.testing.orders import MATERIALS, Order, decode, encode, orders


def first(count: int, seed: int = 1) -> list[Order]:
    return list(islice(orders(seed, clock=lambda: 1_700_000_000_000_000_000), count))


def test_equal_seeds_make_equal_orders() -> None:
    assert first(100, seed=7) == first(100, seed=7)


def test_other_seeds_make_other_orders() -> None:
    assert first(100, seed=7) != first(100, seed=8)


def test_orders_are_counted_from_zero() -> None:
    assert [order.order_id for order in first(5)] == [0, 1, 2, 3, 4]


def test_an_order_has_one_to_seven_products_each_as_often() -> None:
    counts = Counter(len(order.products) for order in first(7_000))
    assert sorted(counts) == [1, 2, 3, 4, 5, 6, 7]
    assert all(count == pytest.approx(1_000, rel=0.15) for count in counts.values())


def test_a_product_has_a_size_a_weight_a_material_and_a_place() -> None:
    for order in first(500):
        for product in order.products:
            size, place = product.dimensions, product.coordinates
            assert min(size.height, size.width, size.length) > 0
            assert product.weight > 0
            assert product.material in MATERIALS
            assert min(place.x, place.y, place.z) >= 0


def test_an_order_comes_back_from_its_json() -> None:
    for order in first(100):
        assert decode(encode(order)) == order


def test_an_order_is_json_that_anybody_can_read() -> None:
    order = first(1)[0]
    read = json.loads(encode(order).decode('utf-8'))
    assert list(read) == ['order_id', 'created_ns', 'products']
    assert list(read['products'][0]) == ['dimensions', 'weight', 'material', 'coordinates']


def test_an_order_takes_550_bytes_in_the_mean() -> None:
    assert mean(len(encode(order)) for order in first(5_000)) == pytest.approx(550, rel=0.02)


@pytest.mark.parametrize('value', [b'', b'{}', b'\xff', b'{"order_id": "one"}', b'[1'])
def test_what_is_no_order_is_a_decode_error(value: bytes) -> None:
    with pytest.raises(DecodeError, match='no order'):
        decode(value)


def test_an_order_tells_when_it_was_made() -> None:
    earlier, later = islice(orders(1), 2)
    assert 0 < earlier.created_ns <= later.created_ns
