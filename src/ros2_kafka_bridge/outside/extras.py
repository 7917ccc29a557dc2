"""What needs libraries that come with an extra: whether they are here, and how to install them.

Whether they are here is seen without loading them.
"""

import json
import shlex
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Final
from urllib.parse import unquote, urlsplit

if TYPE_CHECKING:
    from importlib.metadata import Distribution

PUBLISHED: Final = False
"""Whether the name below means this project wherever pip looks: a release sets it.

Until then anybody may have registered it, so that no text says to install it by name alone.
"""

_PROJECT: Final = 'ros2-kafka-bridge'

_NEEDED: Final = {
    'avro': ('fastavro', 'httpx2', 'authlib', 'cachetools'),
    'depth': ('scipy', 'matplotlib'),
    'monitoring': ('prometheus_client', 'starlette', 'uvicorn'),
    'protobuf': ('google.protobuf', 'httpx2', 'authlib', 'cachetools'),
    'tracing': ('opentelemetry.sdk', 'opentelemetry.exporter.otlp.proto.http'),
    'warehouse': ('numpy', 'rclpy', 'scipy', 'starlette', 'uvicorn'),
}
"""What the extra of that name installs, as far as it is imported."""


def missing_extra(name: str) -> str | None:
    """Say what to install for a format or a part of the bridge, None where all of it is here."""
    for module in _NEEDED.get(name, ()):
        if not _is_here(module):
            return f'{name} needs {module}, which is not installed: {install_command(name)}'
    return None


def how_to_get_ros() -> str:
    """Say how a ROS 2 comes here."""
    return f'source your ROS 2 installation, or install its wheels: {install_command("ros")}'


def missing_ros() -> str | None:
    """Say how a ROS 2 comes here, None where one is."""
    if _is_here('rclpy'):
        return None
    return f"ROS 2 is not here (No module named 'rclpy'): {how_to_get_ros()}"


def install_command(extra: str) -> str:
    """How to install an extra into the environment of this program: a line for a shell."""
    python = shlex.quote(sys.executable)
    # uv makes environments without pip.
    pip = f'{python} -m pip install' if _is_here('pip') else f'uv pip install --python {python}'
    return f'{pip} {_wanted(extra)}'


def _is_here(module: str) -> bool:
    try:
        return find_spec(module) is not None
    except ModuleNotFoundError:  # of the package around it
        return False


def _wanted(extra: str) -> str:
    """What pip is to be given: from where this program came, or else the libraries alone."""
    from importlib.metadata import PackageNotFoundError, distribution  # noqa: PLC0415 (heavy)

    try:
        installed = distribution(_PROJECT)
    except PackageNotFoundError:  # run from its source: prose behind it would be names for pip
        checkout = Path(__file__).parents[3]
        is_here = (checkout / 'pyproject.toml').is_file()
        return shlex.quote(f'{checkout if is_here else f"path/to/{_PROJECT}"}[{extra}]')
    if source := _source(installed, extra):
        return source
    # colcon notes no installer: beside a workspace's bridge the name would bring a second one.
    if PUBLISHED and installed.read_text('INSTALLER'):
        return shlex.quote(f'{_PROJECT}[{extra}]')
    return ' '.join(shlex.quote(library) for library in _libraries(installed, extra))


def _source(installed: 'Distribution', extra: str) -> str | None:
    """The checkout or file that it was installed from, if pip has noted one and it is there.

    No repository: what is shown has its address masked, as that of a login, and leads nowhere.
    See https://packaging.python.org/en/latest/specifications/direct-url/.
    """
    noted = json.loads(installed.read_text('direct_url.json') or '{}')
    address = str(noted.get('url', ''))
    if not address.startswith('file:') or 'vcs_info' in noted:
        return None
    path = Path(unquote(urlsplit(address).path))
    editable = '-e ' if noted.get('dir_info', {}).get('editable') else ''
    return editable + shlex.quote(f'{path}[{extra}]') if path.exists() else None


def _libraries(installed: 'Distribution', extra: str) -> list[str]:
    """What the extra asks for, by the metadata: `name[extra]>=1` as pip takes it."""
    split = (line.partition(';') for line in installed.requires or ())
    return [need.strip() for need, _, when in split if f'"{extra}"' in when.replace("'", '"')]
