"""franky and panda_py without a robot: the names, types and errors that the real packages have.

From the type stubs of franky-control 2.0.0 (`_franky.pyi`) and panda-python 1.1.1 (`libfranka.pyi`);
`test_franka.py` compares with the packages themselves where they are installed.

Wrenches are as libfranka has them (robot_state.h, libfranka 0.15): the external wrench "acting on stiffness
frame, expressed relative to the base frame. Forces applied by the robot to the environment are positive". The
stiffness frame K is the end effector's until `setK` moves it (`EE_T_K`), so a moment is about the end
effector.
"""

from __future__ import annotations

from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

IDLE, GUIDING = 1, 3  # of franka::RobotMode


class FrankaScript:
    """What the robot does: a state a millisecond, then an error."""

    def __init__(self, states: list[SimpleNamespace], error: str = "libfranka: UDP receive: Timeout") -> None:
        self.states = list(states)
        self.error = error
        self.width = 0.08
        self.gripper_error: str | None = None
        self.asked: list[tuple[Any, ...]] = []


def state(time_ms: int, **fields: Any) -> SimpleNamespace:
    """libfranka's values: what a test does not say is at rest."""
    reported = {
        "q": np.zeros(7),
        "O_T_EE": np.eye(4),
        "F_T_EE": np.eye(4),
        "EE_T_K": np.eye(4),
        "O_F_ext_hat_K": np.zeros(6),
        "tau_ext_hat_filtered": np.zeros(7),
        "robot_mode": IDLE,
    }
    return SimpleNamespace(time_ms=time_ms, **{**reported, **fields})


class Duration:
    def __init__(self, milliseconds: int) -> None:
        self._ms = milliseconds

    def to_msec(self) -> int:
        return self._ms

    def to_sec(self) -> float:
        return self._ms / 1000.0


class Affine:
    """As franky has it; its matrix is one of Eigen's, in column-major order."""

    def __init__(self, matrix: np.ndarray) -> None:
        self.matrix = np.asfortranarray(matrix)


def fake_franky(script: FrankaScript) -> ModuleType:
    module: Any = ModuleType("franky")

    class FrankyError(Exception):
        pass

    class NetworkException(FrankyError):  # noqa: N818 - franky's name
        pass

    class Robot:
        def __init__(self, fci_hostname: str, *, realtime_config: Any) -> None:
            script.asked.append(("Robot", fci_hostname, realtime_config))
            if not script.states:
                raise NetworkException(script.error)

        @property
        def state(self) -> SimpleNamespace:
            if not script.states:
                raise NetworkException(script.error)
            reported = script.states.pop(0)
            return SimpleNamespace(
                q=reported.q,
                O_T_EE=Affine(reported.O_T_EE),
                F_T_EE=Affine(reported.F_T_EE),
                EE_T_K=Affine(reported.EE_T_K),
                O_F_ext_hat_K=reported.O_F_ext_hat_K,
                tau_ext_hat_filtered=reported.tau_ext_hat_filtered,
                robot_mode=reported.robot_mode,
                time=Duration(reported.time_ms),
            )

    class Gripper:
        def __init__(self, fci_hostname: str) -> None:
            script.asked.append(("Gripper", fci_hostname))

        @property
        def state(self) -> SimpleNamespace:
            if script.gripper_error is not None:
                raise NetworkException(script.gripper_error)
            return SimpleNamespace(width=script.width, is_grasped=False, time=Duration(0))

    module.Robot, module.Gripper, module.Affine, module.Duration = Robot, Gripper, Affine, Duration
    module.Exception, module.NetworkException = FrankyError, NetworkException
    module.RealtimeConfig = SimpleNamespace(Ignore="Ignore", Enforce="Enforce")
    module.RobotMode = SimpleNamespace(Idle=IDLE, Guiding=GUIDING)
    return module


def fake_libfranka(script: FrankaScript) -> ModuleType:
    module: Any = ModuleType("panda_py.libfranka")

    class Robot:
        def __init__(self, franka_address: str, realtime_config: Any, log_size: int = 50) -> None:
            script.asked.append(("Robot", franka_address, realtime_config))
            if not script.states:
                raise RuntimeError(script.error)

        def read_once(self) -> SimpleNamespace:
            if not script.states:
                raise RuntimeError(script.error)
            reported = script.states.pop(0)
            return SimpleNamespace(
                q=reported.q.tolist(),
                O_T_EE=reported.O_T_EE.flatten(order="F").tolist(),
                F_T_EE=reported.F_T_EE.flatten(order="F").tolist(),
                EE_T_K=reported.EE_T_K.flatten(order="F").tolist(),
                O_F_ext_hat_K=reported.O_F_ext_hat_K.tolist(),
                tau_ext_hat_filtered=reported.tau_ext_hat_filtered.tolist(),
                robot_mode=reported.robot_mode,
                time=Duration(reported.time_ms),
            )

    class Gripper:
        def __init__(self, franka_address: str) -> None:
            script.asked.append(("Gripper", franka_address))

        def read_once(self) -> SimpleNamespace:
            if script.gripper_error is not None:
                raise RuntimeError(script.gripper_error)
            return SimpleNamespace(width=script.width, is_grasped=False, time=Duration(0))

    module.Robot, module.Gripper, module.Duration = Robot, Gripper, Duration
    module.RealtimeConfig = SimpleNamespace(kIgnore="kIgnore", kEnforce="kEnforce")
    module.RobotMode = SimpleNamespace(kIdle=IDLE, kGuiding=GUIDING)
    return module
