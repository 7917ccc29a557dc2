"""Spans of the messages on their way, by OpenTelemetry: an extra, off by default.

A direction tells it what happens and is told nothing. The trace context in the headers is carried
without it (`route.trace_context`).
"""
