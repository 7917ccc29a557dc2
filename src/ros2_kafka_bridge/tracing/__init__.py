"""Spans of the messages on their way, by OpenTelemetry: an extra, off by default.

It hears what a pipeline does with a message, adds a `traceparent`, and decides nothing. Without
it the trace context in the headers is carried all the same (`route.trace_context`).
"""
