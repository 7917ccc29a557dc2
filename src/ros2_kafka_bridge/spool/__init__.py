"""The way over the disk, for messages that Kafka cannot take just now.

`spooling` leads there and back, told by its direction when Kafka is away; it asks nobody itself.

A spool is a queue of records in one SQLite file, in the order in which the bridge took them. Each
route from ROS that asks for one has its own, `<directory>/<bridge>.<route>.spool`, and beside it:

    .spool-wal, .spool-shm        SQLite's own, while it is open or after a crash
    .spool.lock                   who has it open, and a copy of its ledger
    .spool.damaged-<UTC time>     a file that was damaged, put aside; the spool goes on without it
    .spool.salvage, .spool.new    for a moment, while a damaged one is repaired

Every row carries a checksum over all its fields. The ledger says which rows there must be; it is
written in the same transaction as they are, and once more into the lock file. What is missing can
so be counted, and a row that was released before does not come back.
"""
