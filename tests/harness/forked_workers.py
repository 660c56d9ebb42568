"""Processes of pytest-xdist, forked from the one that starts them when it has imported the tests.

Each process took four seconds to import the same. They are forked before pytest-xdist has a thread. execnet,
which otherwise starts an interpreter for each, gets them one after the other. For a process that crashes,
execnet starts an interpreter.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys
import threading
import warnings
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from _pytest.pathlib import ImportMode, import_path
from execnet import gateway_io
from execnet.gateway_base import Popen2IO

from harness.forked import import_everything

# What else test modules import, where it is installed.
MODULES = (
    "caesura_lab.report.writers",
    "caesura_lab.teacher.simulated_teaching",
    "caesura_service.app",
    "hypothesis.strategies",
    "jsonschema",
    "nicegui",
    "playwright.sync_api",
)
TESTS = Path(__file__).parents[1]
THREADED = "pyarrow"  # which starts threads when it is imported


class ForkedWorker:
    """A forked process, as execnet uses one of `subprocess.Popen`."""

    def __init__(self, others: list[ForkedWorker]) -> None:
        from_here, to_there = os.pipe()
        from_there, to_here = os.pipe()
        self.pid = os.fork()
        if self.pid == 0:
            for end in (to_there, from_there, *(one.fileno() for other in others for one in other.streams)):
                os.close(end)
            _run(from_here, to_here)
        os.close(from_here)
        os.close(to_here)
        self.stdin, self.stdout = os.fdopen(to_there, "wb"), os.fdopen(from_there, "rb")
        self.streams = (self.stdin, self.stdout)

    def wait(self) -> int:
        """The exit code, once it has ended."""
        return os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])

    def kill(self) -> None:
        os.kill(self.pid, signal.SIGKILL)


class ForkedIO(gateway_io.Popen2IOMaster):
    """The pipes of the next forked process; of a new interpreter when none is left."""

    forked: list[ForkedWorker] = []  # noqa: RUF012 - of all gateways

    def __init__(self, args: list[str], execmodel: Any) -> None:
        if self.forked and args[0] == sys.executable:
            self.popen = self.forked.pop(0)
            Popen2IO.__init__(self, self.popen.stdin, self.popen.stdout, execmodel=execmodel)
        else:
            super().__init__(args, execmodel)


def fork_workers(config: pytest.Config, count: int) -> None:
    """Import what tests need, and fork `count` processes, which the next gateways of execnet use."""
    import_everything()
    for name in MODULES:
        if find_spec(name.partition(".")[0]):
            import_module(name)
    import_tests(config)
    assert len(os.listdir("/proc/self/task")) == 1, "a process with threads cannot be forked"
    for _ in range(count):
        ForkedIO.forked.append(ForkedWorker(ForkedIO.forked))
    gateway_io.Popen2IOMaster = ForkedIO


def import_tests(config: pytest.Config) -> None:
    """Import the test modules of the run, as each process would by itself, and read their constants."""
    places = [config.invocation_params.dir / given.partition("::")[0] for given in config.args]
    sys.modules[THREADED] = None  # type: ignore[assignment]  # what needs it cannot be imported
    try:
        for file in sorted(TESTS.rglob("test_*.py")):
            if any(file.is_relative_to(place) for place in places):
                import_test(file, config.rootpath)
    finally:
        del sys.modules[THREADED]
    if find_spec("hypothesis"):
        from hypothesis import find, settings, strategies  # noqa: PLC0415 - it may not be installed

        find(strategies.booleans(), bool, settings=settings(database=None))  # draws from constants of modules


def import_test(file: Path, root: Path) -> None:
    """One that cannot be imported, or warns, or skips, is left to the processes, which report it."""
    try:
        with warnings.catch_warnings(action="error"):
            import_path(file, mode=ImportMode.importlib, root=root, consider_namespace_packages=False)
    except (Exception, pytest.skip.Exception):
        for name, module in list(sys.modules.items()):
            if getattr(module, "__file__", None) == str(file):
                del sys.modules[name]


def _run(standard_in: int, standard_out: int) -> None:
    """Run what execnet would give to `python -c`."""
    os.dup2(standard_in, 0)
    os.dup2(standard_out, 1)
    sys.stdin, sys.stdout = open(0, closefd=False), open(1, "w", closefd=False)  # noqa: SIM115
    code = 1
    try:
        exec(gateway_io.popen_bootstrapline, {"__name__": "__main__"})
        code = 0
    finally:
        threading._shutdown()
        atexit._run_exitfuncs()
        os._exit(code)
