"""Packages of message types that a test makes up: their .msg files, and what a build installs.

`build_package` does by hand what colcon does with rosidl_generate_interfaces, as far as rclpy
and Fast DDS need it: the same generators, from the wheels, then the compiler.
"""

import contextlib
import io
import json
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
import rosidl_generator_c
import rosidl_generator_py
import rosidl_typesupport_c
import rosidl_typesupport_fastrtps_c
from rosidl_adapter.msg import convert_msg_to_idl
from rosidl_generator_type_description import generate_type_hash

_WHEELS: Final = Path(sys.prefix)
_SUPPORT: Final = 'rosidl_typesupport_fastrtps_c'
_LIBRARIES: Final = (
    'librosidl_runtime_c.so',
    'librosidl_typesupport_c.so',
    'librosidl_typesupport_fastrtps_c.so',
    'librosidl_typesupport_fastrtps_cpp.so',
    'libfastcdr.so.2',
    'librmw.so',
    'librcutils.so',
)


def write_package(folder: Path, name: str, messages: dict[str, str]) -> Path:
    """Write the .msg files of a package into a folder of its name.

    Args:
        folder: Where packages lie.
        name: Of the package.
        messages: Texts by their short names, as `Crane`.
    """
    package = folder / name
    (package / 'msg').mkdir(parents=True, exist_ok=True)
    for short_name, text in messages.items():
        (package / 'msg' / f'{short_name}.msg').write_text(text, encoding='utf-8')
    return package


def install_package(package: Path, prefix: Path, needs: Sequence[str] = ()) -> None:
    """Install what a build installs of a package, but the libraries, by the generators of ROS 2.

    Args:
        package: A folder with a folder msg.
        prefix: What AMENT_PREFIX_PATH will hold.
        needs: The packages of the wheels whose types are used.
    """
    name = package.name
    share = prefix / 'share' / name
    shutil.copytree(package / 'msg', share / 'msg', dirs_exist_ok=True)
    files = _files(package)
    with contextlib.redirect_stdout(io.StringIO()):
        for file in files:
            convert_msg_to_idl(package, name, file, share / 'msg')
        generator = 'rosidl_generator_type_description'
        generate_type_hash(_arguments(generator, package, prefix, share, needs))
    index = prefix / 'share/ament_index/resource_index/rosidl_interfaces'
    index.mkdir(parents=True, exist_ok=True)
    lines = [f'{file.with_suffix(suffix)}\n' for file in files for suffix in ('.idl', '.msg')]
    (index / name).write_text(''.join(lines), encoding='utf-8')


def build_package(package: Path, prefix: Path, needs: Sequence[str] = ()) -> dict[str, str]:
    """Build a package, so that rclpy can publish its types; it takes seconds.

    Args:
        package: A folder with a folder msg.
        prefix: Where it is installed.
        needs: The packages of the wheels whose types are used, with what they use.

    Returns:
        The environment of a process that uses it.
    """
    if not shutil.which('g++') or not Path(sysconfig.get_path('include'), 'Python.h').is_file():
        pytest.skip('no g++, or no headers of Python')
    install_package(package, prefix, needs)
    code = prefix / 'code'
    site = prefix / 'lib/site-packages'
    _generate(package, prefix, code / package.name, needs)
    sources = [*code.rglob('*.c'), *code.rglob('*.cpp'), *site.rglob('*.c')]
    objects = [_compile(source, code, package.name) for source in sources]
    suffix = sysconfig.get_config_var('EXT_SUFFIX')
    library = site / package.name / f'{package.name}_s__rosidl_typesupport_c{suffix}'
    _link(objects, library, needs)
    return {'AMENT_PREFIX_PATH': str(prefix), 'PYTHONPATH': str(site)}


def generate_python(package: Path, prefix: Path, needs: Sequence[str] = ()) -> Path:
    """Generate the Python part of a package that is installed; returns the folder to import from.

    Without the library that it loads.
    """
    site = prefix / 'lib/site-packages'
    python = site / package.name
    arguments = _arguments('rosidl_generator_py', package, prefix, python, needs)
    rosidl_generator_py.generate_py(arguments, ['rosidl_typesupport_c'])
    (python / '__init__.py').touch()
    return site


def _files(package: Path) -> list[Path]:
    return [file.relative_to(package) for file in sorted((package / 'msg').glob('*.msg'))]


def _arguments(
    generator: str, package: Path, prefix: Path, output: Path, needs: Sequence[str]
) -> str:
    """Write the file of arguments that each generator reads."""
    share = prefix / 'share' / package.name
    wheels = _WHEELS / 'share'
    idls = [file.with_suffix('.idl') for file in _files(package)]
    arguments: dict[str, Any] = {
        'package_name': package.name,
        'output_dir': str(output),
        'template_dir': str(wheels / generator / 'resource'),
        'idl_tuples': [f'{share}:{idl}' for idl in idls],
        'include_paths': [f'{need}:{wheels / need}' for need in needs],
        'ros_interface_dependencies': [
            f'{need}:{idl}' for need in needs for idl in (wheels / need / 'msg').glob('*.idl')
        ],
        'type_description_tuples': [f'{idl}:{share / idl.with_suffix(".json")}' for idl in idls],
        'target_dependencies': [],
    }
    output.mkdir(parents=True, exist_ok=True)
    file = prefix / f'{generator}.json'
    file.write_text(json.dumps(arguments), encoding='utf-8')
    return str(file)


def _generate(package: Path, prefix: Path, code: Path, needs: Sequence[str]) -> None:
    def arguments(generator: str, output: Path) -> str:
        return _arguments(generator, package, prefix, output, needs)

    rosidl_generator_c.generate_c(arguments('rosidl_generator_c', code))
    rosidl_typesupport_fastrtps_c.generate_typesupport_fastrtps_c(arguments(_SUPPORT, code))
    # With one support there is nothing to choose from at run time, and no library to load.
    rosidl_typesupport_c.generate_c(arguments('rosidl_typesupport_c', code), [_SUPPORT])
    generate_python(package, prefix, needs)
    for generator in ('rosidl_generator_c', _SUPPORT):
        template = _WHEELS / f'share/{generator}/resource/{generator}__visibility_control.h.in'
        text = template.read_text(encoding='utf-8').replace('@PROJECT_NAME@', package.name)
        text = text.replace('@PROJECT_NAME_UPPER@', package.name.upper())
        (code / 'msg' / template.stem).write_text(text, encoding='utf-8')


def _compile(source: Path, code: Path, name: str) -> Path:
    include = _WHEELS / 'include'
    folders = [code, include, *include.iterdir(), Path(sysconfig.get_path('include'))]
    compiler = ['g++', '-std=c++17'] if source.suffix == '.cpp' else ['gcc']
    output = source.with_suffix(f'{source.suffix}.o')
    flags = ['-c', '-fPIC', '-O0', '-w', f'-DROS_PACKAGE_NAME="{name}"']
    flags += [f'-I{folder}' for folder in (*folders, np.get_include())]
    subprocess.run([*compiler, *flags, str(source), '-o', str(output)], check=True, timeout=300)
    return output


def _link(objects: Sequence[Path], output: Path, needs: Sequence[str]) -> None:
    kinds = ('rosidl_generator_c', 'rosidl_generator_py', 'rosidl_typesupport_c', _SUPPORT)
    of_needs = [f'lib{need}__{kind}.so' for need in needs for kind in kinds]
    flags = [f'-L{_WHEELS}/lib', f'-Wl,-rpath,{_WHEELS}/lib']
    flags += [f'-l:{library}' for library in (*of_needs, *_LIBRARIES)]
    command = ['g++', '-shared', '-o', str(output), *map(str, objects), *flags]
    subprocess.run(command, check=True, timeout=300)
