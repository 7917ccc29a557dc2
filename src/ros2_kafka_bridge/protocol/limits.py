"""From when on a bridge or a route counts as silent or stuck, for all who say so."""

from typing import Final

OLD_S: Final = 10.0
"""Numbers of this age are shown as old."""

SILENT_S: Final = 30.0
"""A supervisor that has told nothing for so long is started again by whoever asks `/livez`."""

STUCK_S: Final = 90.0
"""So long a route's thread has done one thing: some take a minute on purpose."""
