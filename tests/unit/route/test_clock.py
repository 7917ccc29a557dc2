"""The date by which a clock is known to be wrong follows the releases."""

import re
from datetime import UTC, date, timedelta
from pathlib import Path

from ros2_kafka_bridge import __version__
from ros2_kafka_bridge.route import clock

ROOT = Path(__file__).parents[3]


def test_the_date_of_this_version_is_not_later_than_it_and_not_far_behind() -> None:
    """A later one would hold every route with max_age_s, an old one would tell of no clock."""
    assert not clock.problem()
    heading = rf'^## \[{re.escape(__version__)}\] - (\d{{4}}-\d\d-\d\d)$'
    found = re.search(heading, (ROOT / 'CHANGELOG.md').read_text(), re.MULTILINE)
    if found is not None:  # it is out
        made = clock.RELEASED.astimezone(UTC).date()
        assert timedelta(0) <= date.fromisoformat(found[1]) - made <= timedelta(days=31)
