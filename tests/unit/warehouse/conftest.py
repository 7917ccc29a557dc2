"""What the tests of the warehouse share."""

import pytest
from support.warehouse.watched import Watched


@pytest.fixture
def watched() -> Watched:
    return Watched()
