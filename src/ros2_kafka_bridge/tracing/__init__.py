"""Spans of the messages on their way, by OpenTelemetry: an extra, off by default.

The trace context in the headers is carried without it (`route.trace_context`).
"""
