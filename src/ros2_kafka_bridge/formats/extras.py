"""What needs libraries that come with an extra: whether they are here, without loading them."""

from importlib.util import find_spec
from typing import Final

_NEEDED: Final = {
    'avro': ('fastavro', 'httpx2', 'authlib', 'cachetools'),
    'protobuf': ('google.protobuf', 'httpx2', 'authlib', 'cachetools'),
    'monitoring': ('prometheus_client', 'starlette', 'uvicorn'),
    'tracing': ('opentelemetry.sdk', 'opentelemetry.exporter.otlp.proto.http'),
}
"""What the extra of that name installs, as far as it is imported."""


def missing_extra(name: str) -> str | None:
    """Say what to install for a format or a part of the bridge, None where all of it is here."""
    for module in _NEEDED.get(name, ()):
        if not _is_here(module):
            return (
                f'{name} needs {module}, which is not installed: '
                f'pip install "ros2-kafka-bridge[{name}]"'
            )
    return None


def _is_here(module: str) -> bool:
    try:
        return find_spec(module) is not None
    except ModuleNotFoundError:  # of the package around it
        return False
