"""Which orders come to a simulation, and when."""

from collections.abc import Iterator
from random import Random
from typing import NamedTuple

from ros2_kafka_warehouse.domain.execution_profiles import ExecutionProfiles
from ros2_kafka_warehouse.domain.random_orders import random_order
from ros2_kafka_warehouse.domain.site import Site
from ros2_kafka_warehouse.messages.orders import OrderRequest


class OrderPlan(NamedTuple):
    """Which orders come.

    Attributes:
        per_hour: By chance, so many on average.
        most: No more than these; 0: as many as come.
        fixed: (time in seconds, order) of those that come for sure, in order of time.
    """

    per_hour: float = 0.0
    most: int = 0
    fixed: tuple[tuple[float, OrderRequest], ...] = ()

    def requests(
        self, site: Site, profiles: ExecutionProfiles, random: Random
    ) -> Iterator[tuple[float, OrderRequest]]:
        """All orders that will come, and their times in seconds, in order of time."""
        yield from self.fixed
        now_s, number = 0.0, 0
        while self.per_hour and not 0 < self.most <= number:
            number += 1
            now_s += random.expovariate(self.per_hour / 3600)
            yield now_s, random_order(site, random, f'order-{number:05d}', now_s, profiles)
