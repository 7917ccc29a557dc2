"""What `colcon build` runs in a ROS workspace; pip reads pyproject.toml alone.

Name and dependencies come from pyproject.toml, the version from the package. Setuptools would
read pyproject.toml by itself, and stop at its licence: older ones, such as that of Ubuntu 24.04,
know it as a table only.
"""

import re
import tomllib
from pathlib import Path
from typing import Any

from setuptools import Distribution, find_packages, setup

# colcon links this file into its build folder (--symlink-install).
PYPROJECT = Path(__file__).resolve().parent / 'pyproject.toml'
PROJECT = tomllib.loads(PYPROJECT.read_text(encoding='utf-8'))['project']
PACKAGE = 'ros2_kafka_bridge'
FACE = PYPROJECT.parent / 'src' / PACKAGE / '__init__.py'
[VERSION] = re.findall(r"^__version__ = '(.+)'$", FACE.read_text(encoding='utf-8'), re.MULTILINE)


class WithoutPyproject(Distribution):
    """A distribution that is all in this file and setup.cfg."""

    def parse_config_files(self, filenames: Any = None, *args: Any, **more: Any) -> None:
        """Read what there is but pyproject.toml, which is read where nothing else is named."""
        super().parse_config_files(filenames or self.find_config_files(), *args, **more)


setup(
    distclass=WithoutPyproject,
    name=PROJECT['name'],
    version=VERSION,
    description=PROJECT['description'],
    license=PROJECT['license'],
    python_requires=PROJECT['requires-python'],
    install_requires=PROJECT['dependencies'],
    extras_require=PROJECT['optional-dependencies'],
    packages=find_packages('src', include=[PACKAGE, f'{PACKAGE}.*']),
    package_dir={'': 'src'},
    package_data={PACKAGE: ['**/*']},
    exclude_package_data={'': ['*.pyc']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        (f'share/{PACKAGE}/launch', ['launch/bridge.launch.py']),
    ],
    entry_points={
        'console_scripts': [
            f'bridge = {PACKAGE}.ros_run:main',
            f'ros2-kafka-bridge = {PACKAGE}.cli:main',
        ]
    },
    zip_safe=False,
)
