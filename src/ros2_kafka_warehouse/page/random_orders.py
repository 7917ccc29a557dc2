"""Random orders at a rate, as the page's user sets it."""

import asyncio
from collections.abc import Callable
from random import Random

from ros2_kafka_warehouse.domain.execution_profiles import read_execution_profiles
from ros2_kafka_warehouse.domain.random_orders import random_order
from ros2_kafka_warehouse.domain.site import Site
from ros2_kafka_warehouse.page.outbox import NotSent, Outbox


class RandomOrders:
    """Sends random orders, `per_minute` on average; 0 sends none.

    Args:
        site: Its products and stations are ordered.
        outbox: Sends them.
        order_id: Makes the name of the next order.
        now_s: Seconds since the epoch.
    """

    def __init__(
        self, site: Site, outbox: Outbox, order_id: Callable[[], str], now_s: Callable[[], float]
    ) -> None:
        self._site = site
        self._profiles = read_execution_profiles()
        self._outbox = outbox
        self._order_id = order_id
        self._now_s = now_s
        self._random = Random()  # noqa: S311 (orders, no secrets)
        self._changed = asyncio.Event()
        self._per_minute = 0.0

    @property
    def per_minute(self) -> float:
        """How many are sent."""
        return self._per_minute

    def set(self, per_minute: float) -> None:
        """Change the rate; holds at once."""
        self._per_minute = per_minute
        self._changed.set()

    async def run(self) -> None:
        """Send as long as the page runs."""
        while True:
            if await self._changed_within(self._gap_s()):
                continue
            order = random_order(
                self._site, self._random, self._order_id(), self._now_s(), self._profiles
            )
            try:
                await self._outbox.send_order(order)
            except NotSent:  # the page says that Kafka is away; the next one comes in its time
                continue

    def _gap_s(self) -> float | None:
        return self._random.expovariate(self._per_minute / 60) if self._per_minute > 0 else None

    async def _changed_within(self, gap_s: float | None) -> bool:
        """Wait for the gap, or for ever; says whether the rate was changed before its end."""
        try:
            await asyncio.wait_for(self._changed.wait(), gap_s)
        except TimeoutError:
            return False
        self._changed.clear()
        return True
