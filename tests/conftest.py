"""Random examples: thirty a property, and the same in every run, unless a property says otherwise.

`make test ARGS=--hypothesis-profile=default` has a hundred, and others in every run. Ctrl-C ends the
processes that tests start, also where the shell that starts the tests ignores it, as it does for a job in the
background.

Linear algebra has one thread a process, as there are as many processes as processors. With more, threads that
have nothing to do spin, and a test of small matrices takes four times the CPU.

Simulations are shared by the processes of a run, and by later runs of the same sources (`harness/once.py`).

Files of tests are in memory where the machine has room: a journal waits 4 ms for a disk at each commit. They
go with the run. With `TMPDIR=FOLDER make test` they are in a folder of a disk and stay there, as pytest keeps
them.

What is imported and collected lives as long as the process, so the garbage collector passes over it. The
examples of a test make many objects, so it begins after more of them than usual: it took 7 % of the CPU.

A runner of a command makes every command of its application, and the one that runs makes its options and what
reads them; here each is made once a process.
"""

from __future__ import annotations

import gc
import os
import shutil
import signal
import tempfile
from collections.abc import Generator
from functools import cache
from pathlib import Path

import pytest
import typer.main
from hypothesis import Phase, settings

from caesura_protocol.lazy_commands import LazyCommand
from harness.forked import CAN_FORK
from harness.once import KEPT, RUN

# Before numpy is imported, and for processes that tests start.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
GARBAGE = (20_000, 20, 20)  # objects, and collections of a younger generation, that begin one of an older
MEMORY = Path("/dev/shm")
LEAST_FREE = 4 << 30  # [bytes] in memory
# Files that take long, the longest first: those that wait (harness/scheduling.py), then those that compute.
LONG = (
    "tests/dashboard/test_layout_shift.py",
    "tests/dashboard/test_browser.py",
    "tests/dashboard/test_edit_form.py",
    "tests/dashboard/test_corrected_sessions.py",
    "tests/dashboard/test_whole_day.py",
    "tests/dashboard/test_corrections.py",
    "tests/dashboard/test_dropped.py",
    "tests/dashboard/test_start_stop.py",
    "tests/dashboard/",
    "tests/service/security/test_diagnosis.py",
    "tests/faults/",
    "tests/acceptance/test_serve",
    "tests/docs/",
    "tests/deploy/",
    "tests/lab/execution/test_executor.py",
    "tests/service/changepoint/test_compiled_filter.py",
    "tests/service/segmentation/",
    "tests/service/journal/test_reserve.py",
    "tests/protocol/test_payload_unpack_limits.py",
    "tests/lab/",
    "tests/acceptance/",
    "tests/clients/",
    "tests/service/changepoint/",
    "tests/service/sessions/",
)
settings.register_profile("quick", max_examples=30, deadline=None, derandomize=True)
settings.register_profile(  # for `make mutations`: whether it fails, not how little it takes
    "unshrunk", max_examples=30, deadline=None, derandomize=True, phases=(Phase.explicit, Phase.generate)
)
settings.load_profile("quick")
with pytest.MonkeyPatch.context() as patch:  # while the module with the runner takes it from there
    patch.setattr(typer.main, "get_command", cache(typer.main.get_command))
    import typer.testing
LazyCommand.load = cache(LazyCommand.load)  # type: ignore[method-assign]
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Collect no garbage while tests are collected, and none of what lives as long as the process."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(*GARBAGE)
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put files first that take long, so that no process still has one when the others have ended."""

    def place(item: pytest.Item) -> int:
        return next((i for i, start in enumerate(LONG) if item.nodeid.startswith(start)), len(LONG))

    items.sort(key=place)


@pytest.hookimpl(tryfirst=True)
def pytest_configure(config: pytest.Config) -> None:
    """Make the folder of the run; processes of pytest-xdist inherit its name."""
    if RUN not in os.environ:
        in_memory = "TMPDIR" not in os.environ and _has_room(MEMORY)
        os.environ[RUN] = tempfile.mkdtemp(prefix="caesura-tests-", dir=MEMORY if in_memory else None)
        config.add_cleanup(_remove_folder)
        if in_memory:
            os.environ["TMPDIR"] = tempfile.tempdir = os.environ[RUN]


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_setupnodes(config: pytest.Config, specs: list[object]) -> None:
    """Fork the processes of pytest-xdist, with nothing left to write."""
    from harness.forked_workers import fork_workers  # noqa: PLC0415 - pytest-xdist may not be installed

    if CAN_FORK:
        config.get_terminal_writer().flush()
        fork_workers(config, len(specs))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> object:
    """What `make test` asks for, with files that wait beside files that compute."""
    from harness.scheduling import Scheduling  # noqa: PLC0415 - pytest-xdist may not be installed

    return Scheduling(config, log) if config.option.dist == "loadfile" else None


@pytest.hookimpl(tryfirst=True)
def pytest_sessionstart(session: pytest.Session) -> None:
    """Name the folder that later runs find again, before pytest-xdist starts processes."""
    if session.config.pluginmanager.hasplugin("cacheprovider"):
        os.environ.setdefault(KEPT, str(session.config.cache.mkdir("computed")))


def _has_room(folder: Path) -> bool:
    """Whether tests can write files there, and run those that they have compiled."""
    if not os.access(folder, os.W_OK):
        return False
    there = os.statvfs(folder)
    return not there.f_flag & os.ST_NOEXEC and there.f_bavail * there.f_frsize >= LEAST_FREE


def _remove_folder() -> None:
    folder = os.environ.pop(RUN)
    if os.environ.get("TMPDIR") == folder:
        tempfile.tempdir = None
        del os.environ["TMPDIR"]
    shutil.rmtree(folder)
