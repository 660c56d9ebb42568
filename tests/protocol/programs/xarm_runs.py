"""A script for xArm-Python-SDK, run on an arm behind the SDK's signatures.

What UFACTORY states, and this arm does:
- offset and load of the TCP are zeros until the first report, which comes at 5 Hz (xArm-Python-SDK 1.18.4,
  x3/base.py);
- a change of payload or TCP offset brings state 5: the arm "cannot receive and execute any command until set
  state 0" (user manual of UFACTORY Studio, 10.2), and movements have the code 9;
- `robotiq_set_position` resets and activates a gripper, which moves its fingers all the way, unless the
  connection has read that it is activated, or `auto_enable` is false (x3/robotiq.py).
"""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest.mock import DEFAULT

import numpy as np
import pytest

from caesura_protocol.messages import App
from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.programs.xarm_script import xarm_script
from harness.programs import as_file
from harness.xarm_sdk import RecordedApi

FRAME_S = 0.01
TABLE_N = [0.0, 0.0, -8.0, 0.0, 0.0, 0.0]
NOT_READY = 9  # a code
ACTIVATED = 3  # of `gSTA`


def on_xarm(apps: tuple[App, ...], **changed: Any) -> ProgramFile:
    return as_file(apps).model_copy(update={"robot": "xarm7", "gripper": "robotiq_2f_85"} | changed)


class Arm:
    """An arm behind the SDK's signatures: it is where it was sent, and feels a table below a height."""

    def __init__(self, table_m: float = -9.0, grasped: int = 2, wrench: list[float] | None = None) -> None:
        self.pose = [300.0, -300.0, 400.0, 3.14, 0.0, 0.0]
        self.table_m = table_m
        self.wrench = wrench
        self.api = RecordedApi()
        self.is_reset = self.is_known_activated = self.was_activated = False
        self.api.tcp_offset, self.api.tcp_load = [0.0] * 6, [0.0, [0.0] * 3]
        self.api.register_report_callback.side_effect = self.report
        self.api.set_tcp_load.side_effect = self.api.set_tcp_offset.side_effect = self.reset
        self.api.set_state.side_effect = self.set_state
        self.api.robotiq_status = {"gOBJ": grasped, "gSTA": ACTIVATED}
        self.api.robotiq_get_status.side_effect = self.read_gripper
        self.api.robotiq_set_position.side_effect = self.move_gripper
        self.api.get_state.return_value = self.api.get_cmdnum.return_value = (0, 0)
        self.api.get_err_warn_code.return_value = (0, [0, 0])
        self.api.get_position_aa.side_effect = lambda *_: (0, list(self.pose))
        self.api.get_ft_sensor_data.side_effect = lambda *_: (0, self.felt())
        self.api.set_position_aa.side_effect = self.go
        self.api.vc_set_cartesian_velocity.side_effect = self.drift
        self.api.get_gripper_position.return_value = (0, 500)
        self.api.get_vacuum_gripper.return_value = (0, 1)

    def report(self, callback: Callable[[dict[str, Any]], object]) -> bool:
        self.api.tcp_offset, self.api.tcp_load = [0.0, 0.0, 172.0, 0.0, 0.0, 0.0], [0.8, [0.0, 0.0, 50.0]]
        callback({})
        return True

    def reset(self, *values: Any, **stated: Any) -> Any:
        self.is_reset = True
        return DEFAULT

    def set_state(self, state: int) -> Any:
        self.is_reset = self.is_reset and state != 0
        return DEFAULT

    def read_gripper(self, *values: Any) -> Any:
        self.is_known_activated = self.api.robotiq_status["gSTA"] == ACTIVATED
        return DEFAULT

    def move_gripper(self, count: int, auto_enable: bool = True, **stated: Any) -> Any:
        self.was_activated = self.was_activated or (auto_enable and not self.is_known_activated)
        return DEFAULT

    def drop(self) -> None:
        """What any gripper holds falls."""
        self.api.robotiq_status["gOBJ"] = 3
        self.api.get_gripper_position.return_value = (0, 400)
        self.api.get_vacuum_gripper.return_value = (0, 0)

    def felt(self) -> list[float]:
        if self.wrench is not None:
            return self.wrench
        return TABLE_N if self.pose[2] < 1000 * self.table_m else [0.0] * 6

    def go(self, pose: list[float], **stated: Any) -> int:
        if self.is_reset:
            return NOT_READY
        self.pose = list(pose)
        return 0

    def drift(self, speeds: list[float], **stated: Any) -> int:
        self.pose = [p + 0.02 * v for p, v in zip(self.pose, speeds, strict=True)]
        return 0

    def calls(self, name: str) -> list[Any]:
        return [call for call in self.api.mock_calls if call[0] == name]

    def moves(self) -> np.ndarray:
        return np.array([call.args[0] for call in self.calls("set_position_aa")])


class MovingArm(Arm):
    """Movements, and what a force pushes along -z, take their time, which passes while the script sleeps.

    surface_m: the height of what is pressed on, at x and y [m].
    """

    def __init__(self, surface_m: Callable[[float, float], float], **world: Any) -> None:
        super().__init__(**world)
        self.surface_m = surface_m
        self.queue: list[tuple[list[float], float]] = []
        self.velocity = [0.0] * 6
        self.presses = False
        self.api.get_state.side_effect = lambda: (0, 1 if self.queue else 2)
        self.api.get_cmdnum.side_effect = lambda: (0, len(self.queue))
        self.api.set_ft_sensor_mode.side_effect = self.set_ft_sensor_mode

    def set_state(self, state: int) -> Any:
        if state == 4:
            self.queue.clear()
        return super().set_state(state)

    def set_ft_sensor_mode(self, mode: int) -> int:
        self.presses = mode == 2
        return 0

    def felt(self) -> list[float]:
        x, y, z = np.array(self.pose[:3]) / 1000
        return TABLE_N if z <= self.surface_m(x, y) + 1e-6 else [0.0] * 6

    def go(self, pose: list[float], **stated: Any) -> int:
        if self.is_reset:
            return NOT_READY
        self.queue.append((list(pose), stated["speed"]))
        return 0

    def drift(self, speeds: list[float], **stated: Any) -> int:
        self.velocity = list(speeds)
        return 0

    def sleep(self, seconds: float) -> None:
        for _ in range(round(seconds / FRAME_S)):
            self.pose = [p + FRAME_S * v for p, v in zip(self.pose, self.velocity, strict=True)]
            x, y, z = np.array(self.pose[:3]) / 1000
            if self.presses:
                self.pose[2] = 1000 * max(z - 0.03 * FRAME_S, self.surface_m(x, y))
            if self.queue:
                pose, speed = self.queue[0]
                way = np.subtract(pose, self.pose)
                way[2] *= not self.presses
                share = min(1.0, speed * FRAME_S / max(float(np.linalg.norm(way[:3])), 1e-9))
                self.pose = [p + share * w for p, w in zip(self.pose, way.tolist(), strict=True)]
                if share == 1.0:
                    self.queue.pop(0)


def module_of(program: ProgramFile, sleep: Callable[[float], object] = lambda seconds: None) -> ModuleType:
    module = ModuleType("made")
    exec(compile(xarm_script(program), "made.py", "exec"), module.__dict__)
    module.__dict__["time"] = SimpleNamespace(sleep=sleep)
    return module


def moved(program: ProgramFile, arm: MovingArm) -> None:
    made = module_of(program, arm.sleep)
    made.Runner(lambda host, is_radian: arm.api, "10.0.0.3").run(made.APPS)


def stopped(program: ProgramFile, arm: MovingArm) -> str:
    """What a script says where it stops by itself; the arm holds then, and presses nothing."""
    with pytest.raises(Exception, match="app") as raised:
        moved(program, arm)
    assert type(raised.value).__name__ == "Stop"
    assert not arm.presses
    assert not arm.queue
    assert arm.velocity == [0.0] * 6
    assert [call.args[0] for call in arm.calls("set_mode")][-1] == 0
    assert arm.calls("set_state")[-1].args[0] == 0
    return str(raised.value)


def run(program: ProgramFile, **world: Any) -> Arm:
    arm, made = Arm(**world), module_of(program)
    runner = made.Runner(lambda host, is_radian: arm.api, "10.0.0.3")
    try:
        runner.run(made.APPS)
    finally:
        runner.close()
    return arm
