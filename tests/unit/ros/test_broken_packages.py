"""A message package is code of others: what is wrong with it is said, and ends its route alone.

Guarantee 6b. `tests/integration/test_broken_packages.py` shows it in a running bridge.
"""

import importlib
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from support.ros.package import generate_python, install_package, write_package

from ros2_kafka_bridge.config.endpoints import RosSettings
from ros2_kafka_bridge.errors import RouteError, blamed
from ros2_kafka_bridge.ros.types import MessageType, TypeLoader, WantedType, load_type
from ros2_kafka_bridge.threads.stop import Stop

IMPORTED = RosSettings(packages='import')
CRANE = 'acme_msgs/msg/Crane'
Package = Callable[[str], Path]


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Package]:
    """Install a package whose modules have this text."""

    def make(text: str) -> Path:
        source = write_package(tmp_path / 'src', 'acme_msgs', {'Crane': 'float64 height\n'})
        install_package(source, tmp_path)
        module = tmp_path / 'site' / 'acme_msgs' / 'msg' / '__init__.py'
        module.parent.mkdir(parents=True)
        (module.parent.parent / '__init__.py').touch()
        module.write_text(text, encoding='utf-8')
        importlib.invalidate_caches()
        return module

    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    monkeypatch.syspath_prepend(tmp_path / 'site')
    yield make
    for name in [name for name in sys.modules if name.partition('.')[0] == 'acme_msgs']:
        del sys.modules[name]


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('def f(from): pass', 'SyntaxError: invalid syntax (PLACE:1)'),
        ('1 + "a"', "TypeError: unsupported operand type(s) for +: 'int' and 'str' (PLACE:1)"),
        ('assert False', 'AssertionError (PLACE:1)'),
        ('import sys\nsys.exit(3)', 'SystemExit: 3 (PLACE:2)'),
        ('raise RuntimeError("wrong\\nABI")', 'RuntimeError: wrong ABI (PLACE:1)'),
        ('import nowhere', "No module named 'nowhere'"),
        ('raise MemoryError', 'MemoryError (PLACE:1)'),
        ('def f(): f()\nf()', 'RecursionError: maximum recursion depth exceeded (PLACE:1)'),
        ('open("/nowhere")', 'FileNotFoundError: [Errno 2] No such file or directory: '),
        ('class Crane: pass', "AttributeError: type object 'Crane' has no attribute"),
        ('', "AttributeError: module 'acme_msgs.msg' has no attribute 'Crane' (PLACE"),
        ('class E(Exception):\n def __str__(self): return 1/0\nraise E', 'E (PLACE:3)'),
        ('class E(BaseException):\n def __str__(self): raise SystemExit\nraise E', 'E (PLACE:3)'),
        ('class E(SyntaxError):\n msg = filename = property(lambda _: 1/0)\nraise E', 'E (PLACE'),
    ],
)
def test_guarantee_6b_what_a_package_raises_is_said_with_its_place(
    package: Package, text: str, said: str
) -> None:
    module = package(text)
    with pytest.raises(RouteError) as raised:
        load_type(CRANE, 'import')
    problem = str(raised.value)
    assert problem.startswith(f'message type {CRANE} cannot be loaded: ')
    expected = said.replace('PLACE', str(module))
    assert expected in problem or expected.replace(str(module), '') in problem, problem


def test_a_field_with_the_name_of_a_keyword_is_a_package_that_cannot_be_loaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As the generator of ROS 2 makes it: no type of that package can be imported."""
    messages = {'Crane': 'float64 height\n', 'Move': 'float64 from\n'}
    source = write_package(tmp_path / 'src', 'acme_moves', messages)
    install_package(source, tmp_path)
    generate_python(source, tmp_path)
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    monkeypatch.syspath_prepend(tmp_path / 'lib/site-packages')
    with pytest.raises(RouteError, match=r'Crane cannot be loaded: SyntaxError: .*_move\.py:'):
        load_type('acme_moves/msg/Crane', 'import')


FIELDS = 'get_fields_and_field_types = classmethod(lambda _: {"height": "double"})'


def test_a_library_for_another_python_is_named(package: Package) -> None:
    library = 'acme_msgs_s__rosidl_typesupport_c.cpython-38-x86_64-linux-gnu.so'
    module = package(
        'class Crane:\n'
        f'    {FIELDS}\n'
        '    _TYPE_SUPPORT = None\n'
        '    def __import_type_support__():\n'
        '        from rosidl_generator_py import import_type_support\n'
        '        import_type_support("acme_msgs")\n'
    )
    (module.parents[1] / library).touch()
    with pytest.raises(RouteError) as raised:
        load_type(CRANE, 'import')
    python = '.'.join(map(str, sys.version_info[:2]))
    assert str(raised.value) == (
        f'message type {CRANE}: the library of its package cannot be loaded: No module named '
        f"'acme_msgs.acme_msgs_s__rosidl_typesupport_c': there is {library}, and this is Python "
        f'{python}: build the package for it'
    )


@pytest.mark.parametrize(
    'members',
    [
        '_TYPE_SUPPORT = None\n    def __import_type_support__(_): pass',
        *(
            f'_TYPE_SUPPORT = None\n    def __import_type_support__(_): raise {error}'
            for error in (
                'SyntaxError', 'TypeError', 'AssertionError', 'SystemExit', 'RuntimeError',
                'ImportError("x")', 'MemoryError', 'RecursionError', 'OSError(5, "x")',
            )
        ),
        '_TYPE_SUPPORT = 42',
        '_TYPE_SUPPORT = property(lambda _: 1 / 0)',
        'x = 1',
    ],
)  # fmt: skip
def test_a_library_that_gives_no_support_is_said(package: Package, members: str) -> None:
    """Also a class that rclpy would refuse as it makes the first endpoint of it."""
    package(
        f'class Meta(type):\n    _CREATE_ROS_MESSAGE = None\n    {members}\n'
        f'class Crane(metaclass=Meta):\n    {FIELDS}\n'
    )
    with pytest.raises(RouteError, match=f'^message type {CRANE}.* cannot be loaded: '):
        load_type(CRANE, 'import')


def test_an_import_that_takes_long_is_said_and_waited_for(package: Package) -> None:
    module = package('import time\nwhile not GO: time.sleep(0.01)\nimport nowhere')
    go = module.parent / '__init__.py'
    go.write_text(go.read_text().replace('GO', 'getattr(sys, "acme_go", False)'))
    go.write_text('import sys\n' + go.read_text())
    loader = TypeLoader(IMPORTED, patience_s=0.05)
    try:
        for _ in range(3):
            with pytest.raises(
                RouteError, match=r'Crane: the import of its package has not ended'
            ):
                loader.load(WantedType(CRANE))
        assert len([it for it in threading.enumerate() if it.name == f'load {CRANE}']) == 1
        assert _loaded(loader, 'std_msgs/msg/String').name == 'std_msgs/msg/String'
        stop = Stop()
        stop.ask()
        assert loader.load(WantedType(CRANE), stop) is None
    finally:
        sys.acme_go = True  # type: ignore[attr-defined]
        with pytest.raises(RouteError, match='nowhere'):
            _loaded(loader, CRANE)
        del sys.acme_go  # type: ignore[attr-defined]


def _loaded(loader: TypeLoader, name: str) -> MessageType:
    """Wait for a type: on a busy machine any takes longer than this loader waits."""
    deadline_s = time.monotonic() + 20
    while time.monotonic() < deadline_s:
        try:
            loaded = loader.load(WantedType(name))
        except RouteError as error:
            if 'not ended' not in str(error):
                raise
        else:
            assert loaded is not None, 'nothing stops it'
            return loaded
    raise AssertionError(f'{name} is not loaded')


def test_what_could_not_be_loaded_is_tried_again(package: Package) -> None:
    module = package('import nowhere')
    loader = TypeLoader(IMPORTED)
    with pytest.raises(RouteError, match='nowhere'):
        loader.load(WantedType(CRANE))
    module.write_text('import elsewhere', encoding='utf-8')
    importlib.invalidate_caches()
    with pytest.raises(RouteError, match='elsewhere'):
        loader.load(WantedType(CRANE))


def test_only_the_users_own_interrupt_passes() -> None:
    with pytest.raises(KeyboardInterrupt), blamed('x'):
        raise KeyboardInterrupt
    raised: list[BaseException] = []

    def work() -> None:
        try:
            with blamed('x'):
                raise KeyboardInterrupt
        except RouteError as error:
            raised.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert [str(error).partition(' (')[0] for error in raised] == ['x: KeyboardInterrupt']
