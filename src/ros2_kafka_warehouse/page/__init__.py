"""The live page: a plain Kafka client that shows the warehouse and takes orders and commands.

A record's way to the screen: `feed` (Kafka) -> `view` (the newest of everything) -> `rows` (what
a browser is told) -> `app` (server-sent events) -> `static/`. The other way: `app` -> `forms` (a
body becomes a message) -> `outbox` (Kafka).
"""
