"""What the paper published: section VII, Tables I to III and the prose beside them.

The paper names no rates. They follow from its counts in ten minutes: 5,787 orders are 9.6 a
second, 50,152 and 51,683 about 86, 95,664 to 98,733 about 160.
"""

from typing import Final

import pandas as pd

SECONDS: Final = 600.0
"""How long each of its experiments ran."""

TABLES: Final = {'I': 10, 'II': 100, 'III': 200}
"""The depth of KEEP_LAST that each table is about."""

RATES: Final = {'9.6': 9.6, '86': 86.0, '160': 160.0}
"""Orders per second of its loads, by our names of them."""

MACHINE: Final = '2.60 GHz 6-core Intel Core i7, 16 GB DDR4 at 2400 MHz, macOS Big Sur 11.5'
PLACES: Final = 'every part in a container of its own, with 1.941 GiB each'


def published() -> pd.DataFrame:
    """Its experiments by load and depth, in the columns in which ours are measured.

    The counts are those of the tables. The prose has the latency of the fastest and the slowest
    order, no median, and the memory of the containers.
    """
    columns = [
        'Load', 'Depth',
        'producer_orders', 'kafka_ros_orders', 'ros_kafka_orders', 'consumer_orders',
        'latency_fastest_ms', 'latency_slowest_ms',
        'kafka_ros_before_mib', 'kafka_ros_peak_mib', 'ros_kafka_before_mib', 'ros_kafka_peak_mib',
    ]  # fmt: skip
    rows = [
        ('9.6', 10, 5787, 5787, 5787, 5787, 6.791, 282.652, 24.43, 25.17, 24.20, 25.2),
        ('86', 10, 51683, 51683, 51593, 51593, 6.467, 851.981, 24.45, 26.2, 24.32, 25.8),
        ('160', 10, 95664, 95664, 92195, 92195, 6.247, 1107.546, 24.43, 26.54, 24.18, 26.54),
        ('86', 100, 50152, 50152, 50152, 50152, 6.465, 1023.807, 24.46, 26.36, 24.21, 26.43),
        ('160', 100, 98733, 98733, 98503, 98503, 6.582, 746.120, 24.82, 26.60, 24.26, 26.74),
        ('160', 200, 97995, 97995, 97995, 97995, 6.730, 1029.223, 24.64, 28.44, 24.40, 28.35),
    ]
    found = pd.DataFrame(rows, columns=columns)
    found['Load'] = found['Load'].map(words)
    found['lost_orders'] = found['producer_orders'] - found['consumer_orders']
    found['lost_share'] = found['lost_orders'] / found['producer_orders']
    return found.set_index(['Load', 'Depth'])


def words(load: str) -> str:
    """Name one of its loads for a reader, as ours are."""
    return f'{load} orders/s'
