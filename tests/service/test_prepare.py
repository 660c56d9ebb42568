"""Kernels are compiled by another process: code that a process compiled itself may give other last bits."""

from __future__ import annotations

import sys

import pytest

from caesura_service import prepare


@pytest.mark.parametrize("kept", [False, True])
def test_another_process_compiles_before_this_one_loads(monkeypatch: pytest.MonkeyPatch, kept: bool) -> None:
    steps: list[object] = []
    monkeypatch.setattr(prepare, "is_compiled", lambda: kept)
    monkeypatch.setattr(prepare.subprocess, "run", lambda command, **_: steps.append(command))
    monkeypatch.setattr(prepare, "_load", lambda: steps.append("load"))
    prepare.prepare()
    compiled = [sys.executable, "-m", "caesura_service.prepare"]
    assert steps == (["load"] if kept else [compiled, "load"])
