"""Orders as they come on a usual day, made by chance that can be repeated."""

from collections.abc import Iterable
from datetime import UTC, datetime
from random import Random
from typing import Final

from ros2_kafka_warehouse.domain.execution_profiles import ExecutionProfiles, RobotType
from ros2_kafka_warehouse.domain.site import Product, Site
from ros2_kafka_warehouse.messages.orders import Line, OrderRequest

MOST_LINES: Final = 7
MOST_PIECES: Final = 5
MOST_KG: Final = 25.0  # of most lines: a load for the smaller robots
HEAVY: Final = 0.1  # of the lines are heavier
DUE_S: Final = (240.0, 900.0)


def random_order(
    site: Site,
    random: Random,
    order_id: str,
    now_s: float,
    profiles: ExecutionProfiles,
) -> OrderRequest:
    """An order of one to seven lines, the more the rarer, due in some minutes.

    Every line fits on some robot of the site; `profiles` say what each type of them can carry.
    """
    kinds = [
        profiles.robot_types[name]
        for name in sorted({robot.robot_type for robot in site.robots.values()})
        if name in profiles.robot_types
    ]
    most_kg = {name: _most_kg(product, kinds) for name, product in sorted(site.products.items())}
    names = [name for name, kg in most_kg.items() if kg >= site.products[name].weight_kg]
    count = min(1 + int(random.expovariate(0.6)), MOST_LINES, len(names))
    lines = []
    for number, name in enumerate(random.sample(names, count), 1):
        product = site.products[name]
        kg = most_kg[name]
        if random.random() >= HEAVY:
            kg = min(kg, MOST_KG)
        # Compared before it is rounded: of what weighs nearly nothing, infinitely many fit.
        most = max(1, int(min(MOST_PIECES, kg / product.weight_kg)))
        lines.append(Line(f'L{number}', name, random.randint(1, most)))
    return OrderRequest(
        order_id=order_id,
        station=random.choice(sorted(site.stations)),
        lines=tuple(lines),
        priority=random.choice((0, 0, 0, 0, 3, 6, 9)),
        due_time=datetime.fromtimestamp(round(now_s + random.uniform(*DUE_S), 3), UTC),
    )


def _most_kg(product: Product, kinds: Iterable[RobotType]) -> float:
    return max((kind.max_load_kg for kind in kinds if product.size in kind.sizes), default=0.0)
