"""How long a run waits for something.

`TEST_PATIENCE` stretches it on a machine that is busy: 1 by default, 3 where CI=true.
"""

import os
from typing import Final

IS_CI: Final = os.environ.get('CI') == 'true'
PATIENCE: Final = float(os.environ.get('TEST_PATIENCE') or (3 if IS_CI else 1))


def patient(seconds: float) -> float:
    """So many seconds on a quiet machine, more on one that is busy."""
    return seconds * PATIENCE
