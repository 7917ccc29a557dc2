"""`python -m ros2_kafka_warehouse`."""

import signal

# Who presses Ctrl-C while all is imported wants an end, and no traceback of the imports.
before = signal.signal(signal.SIGINT, signal.SIG_DFL)
if before is signal.SIG_IGN:  # by a shell, in the background
    signal.signal(signal.SIGINT, before)

from ros2_kafka_warehouse.cli import main  # noqa: E402 (for that)

signal.signal(signal.SIGINT, before)
main()
