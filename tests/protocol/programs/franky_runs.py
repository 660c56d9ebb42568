"""A script for franky, run against the fake of its API."""

from __future__ import annotations

from collections.abc import Callable
from itertools import accumulate
from types import ModuleType
from typing import Any

import pytest

from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.programs.franky_script import franky_script

from . import fake_franky


def module_of(program: ProgramFile) -> ModuleType:
    module = ModuleType("made")
    exec(compile(franky_script(program), "made.py", "exec"), module.__dict__)
    module.__dict__["time"] = type("time", (), {"sleep": staticmethod(lambda seconds: None)})
    return module


def run(program: ProgramFile) -> list[tuple[str, dict[str, Any]]]:
    fake_franky.calls.clear()
    made = module_of(program)
    made.Runner(fake_franky, "robot").run(made.checked(made.APPS))
    return list(fake_franky.calls)


def motions(calls: list[tuple[str, dict[str, Any]]]) -> list[Any]:
    return [arguments["motion"] for name, arguments in calls if name == "move"]


def passed(motion: Any) -> list[tuple[float, Any]]:
    """The way points of a motion: when each is passed [s], and its state."""
    times = accumulate(one.minimum_time.milliseconds / 1000.0 for one in motion.waypoints)
    return list(zip(times, (one.target for one in motion.waypoints), strict=True))


def passed_at(motion: Any, place: tuple[float, ...]) -> tuple[float, Any]:
    """When a motion passes a place [s], and the state there."""
    return next(one for one in passed(motion) if tuple(one[1].pose.translation.tolist()) == place)


def flanges(pressed: fake_franky.CartesianImpedanceTrackingMotion) -> list[fake_franky.Affine]:
    """The poses of the flange to which a press leads the robot."""
    return [one.target * fake_franky.RobotState.F_T_EE.inverse for one in pressed.references]


def over_surface(
    monkeypatch: pytest.MonkeyPatch, program: ProgramFile, surface_m: Callable[[float, float], float]
) -> tuple[ModuleType, Any]:
    """A script, and its runner of a robot over a surface."""
    fake_franky.calls.clear()
    monkeypatch.setattr(fake_franky, "Robot", fake_franky.MovingRobot)
    monkeypatch.setattr(fake_franky.MovingRobot, "surface_m", staticmethod(surface_m), raising=False)
    made = module_of(program)
    return made, made.Runner(fake_franky, "robot")


def stopped(
    monkeypatch: pytest.MonkeyPatch, program: ProgramFile, surface_m: Callable[[float, float], float]
) -> str:
    """What a script says where it stops by itself; no motion goes on then."""
    made, runner = over_surface(monkeypatch, program, surface_m)
    with pytest.raises(made.Stop) as raised:
        runner.run(made.APPS)
    assert not isinstance(motions(fake_franky.calls)[-1], fake_franky.CartesianImpedanceTrackingMotion)
    return str(raised.value)


def pressed_n(
    monkeypatch: pytest.MonkeyPatch, program: ProgramFile, surface_m: Callable[[float, float], float]
) -> list[float]:
    """The forces [N] with which a script presses on a surface, one a period."""
    felt: list[float] = []
    joined = fake_franky.MovingRobot.join_motion

    def join_motion(robot: Any, timeout: float | None = None) -> bool:
        ended = joined(robot, timeout)
        felt.append(robot.felt_n())
        return ended

    made, runner = over_surface(monkeypatch, program, surface_m)
    monkeypatch.setattr(fake_franky.MovingRobot, "join_motion", join_motion)
    runner.run(made.APPS)
    return felt
