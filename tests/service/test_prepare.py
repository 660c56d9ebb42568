"""Kernels are compiled by another process: code that a process compiled itself may give other last bits."""

from __future__ import annotations

import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from caesura_service import prepare
from caesura_service.numba_support import is_compiled

pytest.importorskip("numba", reason="numba is not installed (extra service)")
from caesura_service.numba_support import decorators
from harness.processes import DEADLINE_S, environment, started

NOT_LOADED = """
import inspect, re
from caesura_service.changepoint import compiled_filter
from caesura_service.changepoint.kernels import steps
from caesura_service.prepare import prepare
prepare()
called = sorted(set(re.findall(r"steps\\.(\\w+)\\(", inspect.getsource(compiled_filter))))
print(len(called), *(name for name in called if not getattr(steps, name).signatures))
"""


@pytest.mark.parametrize("kept", [False, True])
def test_another_process_compiles_before_this_one_loads(monkeypatch: pytest.MonkeyPatch, kept: bool) -> None:
    steps: list[object] = []
    monkeypatch.setattr(prepare, "is_compiled", lambda: kept)
    monkeypatch.setattr(prepare.subprocess, "run", lambda command, **_: steps.append(command))
    monkeypatch.setattr(prepare, "_load", lambda: steps.append("load"))
    prepare.prepare()
    compiled = [sys.executable, "-m", "caesura_service.prepare"]
    assert steps == (["load"] if kept else [compiled, "load"])


def test_an_interrupted_compilation_is_begun_again(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A part of the code was cached: each start compiled the rest in the service, silently, for minutes."""
    monkeypatch.setattr(decorators, "cache_directory", lambda _room: tmp_path / "kept")
    monkeypatch.setattr(prepare, "_load", interrupt)
    with pytest.raises(KeyboardInterrupt):
        prepare.main()
    assert not is_compiled()
    monkeypatch.setattr(prepare, "_load", lambda: None)
    prepare.main()
    assert is_compiled()
    monkeypatch.setattr(decorators, "SERVICE", tmp_path)  # code is cached by the place of its source
    assert not is_compiled()


def test_of_instances_that_start_at_once_one_compiles(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Each of four compiled all kernels: on two processors their supervisor ended them for being silent."""
    monkeypatch.setattr(decorators, "cache_directory", lambda _room: tmp_path / "kept")
    begun, may_end, compiled = threading.Event(), threading.Event(), list[int]()

    def compile_() -> None:
        compiled.append(threading.get_ident())
        begun.set()
        assert may_end.wait(DEADLINE_S)

    monkeypatch.setattr(prepare, "_load", compile_)
    with ThreadPoolExecutor(3) as instances:
        first = instances.submit(prepare.main)
        assert begun.wait(DEADLINE_S)
        others = [instances.submit(prepare.main) for _ in range(2)]
        may_end.set()
        for one in (first, *others):
            one.result(DEADLINE_S)
    assert len(compiled) == 1
    assert is_compiled()


def interrupt() -> None:
    raise KeyboardInterrupt


def test_no_session_loads_a_kernel():
    """One was loaded at the first edit: out of open files, that closed the session by an error."""
    command = [sys.executable, "-c", NOT_LOADED]
    with started(command, stdout=subprocess.PIPE, env=environment()) as process:
        count, *names = process.communicate(timeout=DEADLINE_S)[0].split()
    assert (int(count) >= 4, names) == (True, [])
