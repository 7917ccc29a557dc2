"""Traces through the bridge: W3C trace context in headers, spans by OpenTelemetry."""
