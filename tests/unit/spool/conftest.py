"""What the tests of a direction with a spool share."""

from pathlib import Path
from typing import Any

import pytest
from houses import House, Make


@pytest.fixture
def house(tmp_path: Path) -> Make:
    """Makes lives, all with the same spool."""

    def make(spool: dict[str, Any] | None = None, **more: Any) -> House:
        return House(tmp_path, spool, **more)

    return make
