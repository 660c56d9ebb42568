"""Arms that a hand guides for some time, by the fakes of their vendors' packages."""

from __future__ import annotations

import itertools
import sys
import threading
from collections.abc import Iterator, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from caesura_clients.bridge.sources import Chunk, Mark, xarm_arm
from caesura_clients.bridge.sources.registry import SourceOptions, open_source
from caesura_protocol.errors import SourceError
from clients import fake_franka, fake_ur, fake_xarm

ARMS = ("franky", "panda", "ur", "xarm")
RATE_HZ = {"franky": 1000, "panda": 1000, "ur": 500, "xarm": 100}
ZERO_TCP = "0,0,0,0,0,0"
OPTIONS = {
    "franky": SourceOptions(host="10.0.0.2", gripper=False),
    "panda": SourceOptions(host="10.0.0.2", gripper=False),
    "ur": SourceOptions(host="10.0.0.2", robot="ur5e", tcp_offset=ZERO_TCP, wrench_source="none"),
    "xarm": SourceOptions(host="10.0.0.2", robot="xarm7", tcp_offset=ZERO_TCP, wrench_source="none"),
}
M_PER_STATE = 1e-4  # along x, so that a position names its state


class GuidedArm:
    """An arm as its source reads it from a vendor's fake; it stays connected until `over`.

    phases: (seconds, is the button pressed?), one after the other, from `go` on.
    """

    can_wait = False

    def __init__(
        self,
        monkeypatch: pytest.MonkeyPatch,
        name: str,
        phases: Sequence[tuple[float, bool]],
        go: threading.Event,
        over: threading.Event,
    ) -> None:
        pressed = [
            is_pressed for seconds, is_pressed in phases for _ in range(round(seconds * RATE_HZ[name]))
        ]
        _play(monkeypatch, name, pressed)
        self._arm = open_source(name, OPTIONS[name])
        self._go, self._over = go, over

    def __getattr__(self, name: str) -> Any:
        return getattr(self._arm, name)

    def chunks(self) -> Iterator[Chunk | Mark]:
        self._go.wait()
        try:
            yield from self._arm.chunks()
        except SourceError:  # the fake has no more states
            self._over.wait()


def _play(monkeypatch: pytest.MonkeyPatch, name: str, pressed: list[bool]) -> None:
    """Put a vendor's fake in place, with a state for each value."""
    modules: dict[str, Any]
    if name == "ur":
        pose = [[0.4 + M_PER_STATE * i, 0.1, 0.2, 0.0, 0.0, 0.0] for i in range(len(pressed))]
        states = [
            fake_ur.state(5000.0 + 0.002 * i, pose=pose[i], status=0b111 if is_pressed else 0b011)
            for i, is_pressed in enumerate(pressed)
        ]
        modules = fake_ur.fake_ur(fake_ur.UrScript(states))
    elif name == "xarm":
        reports = [
            fake_xarm.report(cartesian=[400.0 + 1000 * M_PER_STATE * i, 0, 200, 0, 0, 0], mode=2 * is_pressed)
            for i, is_pressed in enumerate(pressed)
        ]
        clock = itertools.count()
        monkeypatch.setattr(xarm_arm, "SILENT_S", 0.01)
        monkeypatch.setattr(xarm_arm, "time", SimpleNamespace(monotonic=lambda: 0.01 * next(clock)))
        modules = fake_xarm.fake_xarm(fake_xarm.XArmScript(reports))
    else:
        modes = [fake_franka.GUIDING if is_pressed else fake_franka.IDLE for is_pressed in pressed]
        script = fake_franka.FrankaScript(
            [fake_franka.state(5000 + i, O_T_EE=_moved(i), robot_mode=mode) for i, mode in enumerate(modes)]
        )
        modules = {
            "franky": fake_franka.fake_franky(script),
            "panda_py.libfranka": fake_franka.fake_libfranka(script),
        }
    for module, fake in modules.items():
        monkeypatch.setitem(sys.modules, module, fake)


def _moved(count: int) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = [0.4 + M_PER_STATE * count, 0.1, 0.2]
    return matrix
