"""The clocks of this machine: the one since boot, and whether the time of day can be right."""

import time
from datetime import UTC, datetime
from typing import Final

RELEASED: Final = datetime(2026, 11, 1, tzinfo=UTC)
"""This version was made later; set with `__version__`. A clock that shows less is wrong."""

RELEASED_NS: Final = int(RELEASED.timestamp()) * 1_000_000_000
"""The same, since 1970."""


def problem() -> str:
    """Why the time of day cannot be right; empty where it can.

    A robot without a battery for its clock begins in 1970, and is set when the network comes.
    """
    now_s = time.time()
    if now_s >= RELEASED.timestamp():
        return ''
    today = datetime.fromtimestamp(max(0.0, now_s), UTC)
    return (
        f"this machine's clock says {today:%Y-%m-%d}, and this version of the bridge was made "
        f'after {RELEASED:%Y-%m-%d}: set it (timedatectl, chronyc makestep)'
    )


def since_boot_ns() -> int:
    """The clock that nobody sets, and that goes on while the machine sleeps."""
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME)


def since_boot_s() -> float:
    """The same in seconds."""
    return since_boot_ns() / 1e9
