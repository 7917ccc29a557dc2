"""Python processes that begin with what all of them import.

A bridge takes a second of CPU time to begin, and a node of ROS half of one, most of it to import
and to link: for all tests together that was a third of what they took. These are forked from a
process that has done so, and take a fifth of that. From there on they are what a process is that
was started by its command: with a number, an environment, signals and files of its own. They end
by `os._exit`: what Python does at its own end is left to those that begin by a command.
"""

import contextlib
import ctypes
import faulthandler
import gc
import multiprocessing
import os
import runpy
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from multiprocessing import forkserver, util
from pathlib import Path
from typing import Any, Final, NoReturn

_CONTEXT: Final = multiprocessing.get_context('forkserver')
_TESTS: Final = Path(__file__).parents[2]
_PR_SET_PDEATHSIG: Final = 1
_WORKER: Final = 'ros2_kafka_bridge.process.worker'
_execv: Final = os.execv


class Warm:
    """A process of Python, with the methods of `subprocess.Popen` that tests need.

    It ends with the process that it was forked from, which ends with that of the tests.

    Args:
        arguments: Those of Python: `-P -m MODULE ...`, `-m MODULE ...` or a script and its own.
        log: Its output goes to the end of this file.
        environ: Added to the environment of the tests.
    """

    def __init__(self, arguments: Sequence[str], log: Path, environ: Mapping[str, str]) -> None:
        self._arguments = list(arguments)
        log.touch()  # it is read before the process has begun
        _ensure_template()
        self._process = _CONTEXT.Process(
            target=_become,
            args=(self._arguments, log, {**os.environ, **environ}, Path.cwd()),
            daemon=True,
        )
        self._process.start()
        # One that a test has lost is not waited for: at its end Python asks, and waits for ever.
        util.Finalize(None, self._process.kill, exitpriority=0)

    @property
    def pid(self) -> int:
        """Its number."""
        assert self._process.pid is not None, 'it has been started'
        return self._process.pid

    def poll(self) -> int | None:
        """The exit status, None while it runs."""
        return self._process.exitcode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end; returns the exit status."""
        self._process.join(timeout)
        if self._process.exitcode is None:
            assert timeout is not None
            raise subprocess.TimeoutExpired(self._arguments, timeout)
        return self._process.exitcode

    def send_signal(self, number: int, /) -> None:
        """Send a signal, if it runs."""
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):  # its status is on the way
                os.kill(self.pid, number)


def _ensure_template() -> None:
    """Start the process that others are forked from, if it does not run."""
    forkserver.set_forkserver_preload(['support.processes.warm_modules', 'support.processes.warm'])
    before = os.environ.get('PYTHONPATH')
    os.environ['PYTHONPATH'] = str(_TESTS)  # Python 3.11 does not tell it sys.path
    try:
        forkserver.ensure_running()
    finally:
        del os.environ['PYTHONPATH']
        if before is not None:
            os.environ['PYTHONPATH'] = before


def _become(arguments: list[str], log: Path, environ: dict[str, str], place: Path) -> None:
    template = os.getppid()
    end_with_parent()
    if os.getppid() != template:
        os._exit(1)
    os.setsid()  # its own children end with it
    gc.freeze()
    _own_files(log)
    faulthandler.enable()  # a crash names its place in the log
    os.chdir(place)
    os.environ.clear()
    os.environ.update(environ)
    sys.path[:] = [entry for entry in sys.path if Path(entry) not in {_TESTS, _TESTS.parent}]
    os.execv = _go_on
    _run(arguments)


def _go_on(path: Any, command: Any) -> NoReturn:
    """Run the worker that a bridge becomes, with what this process has loaded."""
    if _WORKER not in command:
        _execv(path, command)
    _run(command[1:])
    sys.exit(0)


def end_with_parent() -> None:
    """Have this process killed when the one that has started it ends, however that ends."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def _own_files(log: Path) -> None:
    nothing = os.open(os.devnull, os.O_RDONLY)
    output = os.open(log, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    for number, own in enumerate((nothing, output, output)):
        os.dup2(own, number)
    # The connection to the process of the tests is not for its children.
    for link in Path('/proc/self/fd').iterdir():
        if int(link.name) > 2:
            with contextlib.suppress(OSError):  # that of the listing is closed
                os.set_inheritable(int(link.name), False)  # noqa: FBT003 (as Python has it)
    os.close(nothing)
    os.close(output)


def _run(arguments: list[str]) -> None:
    match arguments:
        case ['-P', '-m', module, *words]:
            sys.modules.pop(module, None)  # it was imported, and is to begin anew
            sys.argv = [module, *words]
            runpy.run_module(module, run_name='__main__', alter_sys=True)
        case ['-m', module, *words]:
            sys.argv = [module, *words]
            sys.path.insert(0, str(_TESTS.parent))
            runpy.run_module(module, run_name='__main__', alter_sys=True)
        case [script, *words]:
            sys.argv = [script, *words]
            sys.path.insert(0, str(Path(script).parent))
            runpy.run_path(script, run_name='__main__')
