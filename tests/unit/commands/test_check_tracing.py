"""What `check` says of tracing that leads nowhere."""

import pytest

from ros2_kafka_bridge.commands.check.report import tracing_notes
from ros2_kafka_bridge.config.file import loads

FILE = """
name: shop
kafka: {bootstrap.servers: localhost:9092}
%s
routes:
- {name: orders, format: text, %s}
"""
TO_KAFKA = 'from: {ros: /orders}, to: {kafka: orders}'
TO_ROS = 'from: {kafka: orders}, to: {ros: /orders, type: std_msgs/msg/String}'
OF_ENVIRONMENT = {'OTEL_EXPORTER_OTLP_ENDPOINT': 'http://collector:4318'}


def said(tracing: str, environ: dict[str, str], ends: str = TO_KAFKA) -> list[str]:
    return list(tracing_notes(loads(FILE % (tracing, ends), 'shop.yaml', {}), environ))


@pytest.mark.parametrize('environ', [{}, OF_ENVIRONMENT | {'OTEL_SDK_DISABLED': 'true'}])
def test_sampled_traces_without_spans_are_a_note(environ: dict[str, str]) -> None:
    [note] = said('tracing: {sample: 0.05}', environ)
    assert 'a share of 0.05 of the records' in note
    assert 'set endpoint' in note


@pytest.mark.parametrize(
    ('tracing', 'environ'),
    [
        ('', {}),
        ('tracing: {sample: 0}', {}),
        ('tracing: {}', OF_ENVIRONMENT),
        ('tracing: {endpoint: "http://localhost:4318/v1/traces"}', {}),
    ],
)
def test_all_else_is_none(tracing: str, environ: dict[str, str]) -> None:
    assert said(tracing, environ) == []


def test_a_bridge_that_writes_no_records_names_no_parent() -> None:
    assert said('tracing: {sample: 0.05}', {}, TO_ROS) == []
