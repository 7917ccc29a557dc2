"""Messages with random values."""

import random
import struct
from typing import Any

from messages import filled

from ros2_kafka_bridge.message_types.layout import PRIMITIVES

ALPHABET = 'abc xyz_09/äßж日𝄞'


def random_message(type_name: str, seed: int) -> Any:
    return filled(type_name, RandomSource(seed))


class RandomSource:
    """Numbers that are equal to themselves, and short texts."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)  # noqa: S311 -- repeatable

    def number(self, name: str) -> Any:
        if name == 'bool':
            return self.random.random() < 0.5
        if name in {'float32', 'float64'}:
            return self.random.randint(-1000, 1000) / 4
        code = '<' + PRIMITIVES[name]
        return struct.unpack(code, self.random.randbytes(struct.calcsize(code)))[0]

    def text(self) -> str:
        return ''.join(self.random.choices(ALPHABET, k=self.random.randint(0, 6)))

    def length(self, most: int | None) -> int:
        return self.random.randint(0, 3 if most is None else min(3, most))
