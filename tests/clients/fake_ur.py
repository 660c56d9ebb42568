"""ur_rtde without a robot: the calls that the source makes, with their signatures, written down.

The force is as Universal Robots states it: "all measured at the tool flange with the orientation of the robot
base coordinate system" (Script Directory of the e-Series, get_tcp_force); "returned at the tool flange on
e-series robots and at the tcp for CB3" (its ROS 2 driver, pull request 1287). The payload's weight is taken
off. Its sign is the environment's on the robot: with a payload of 1 kg that is stated and not there, a
controller reports +9.82 N along z (UR's forum, topic 2053).

Signatures are those of the docstrings of ur_rtde 1.6.5; `test_ur.py` compares them with the package where it
is installed.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from types import ModuleType, SimpleNamespace
from typing import Any

from caesura_protocol.flange_pose import flange_of, moved_wrench, pose_of_rotation_vector

RECEIVE = "rtde_receive.RTDEReceiveInterface"
CONTROL = "rtde_control.RTDEControlInterface"
SIGNATURES = {
    RECEIVE: {
        "__init__": "hostname: str, frequency: float = -1.0, variables: list[str] = [], ",
        "getTimestamp": ") -> float",
        "getActualQ": ") -> list[float]",
        "getActualTCPPose": ") -> list[float]",
        "getActualTCPForce": ") -> list[float]",
        "getRobotStatus": ") -> int",
        "isConnected": ") -> bool",
        "isEmergencyStopped": ") -> bool",
        "isProtectiveStopped": ") -> bool",
        "initPeriod": ") -> datetime.timedelta",
        "waitPeriod": ", arg0: datetime.timedelta) -> None",
        "disconnect": ") -> None",
    },
    CONTROL: {
        "__init__": "hostname: str, frequency: float = -1.0, ",
        "getTCPOffset": ") -> list[float]",
        "zeroFtSensor": ") -> bool",
        "teachMode": ") -> bool",
        "endTeachMode": ") -> bool",
        "stopScript": ") -> None",
        "disconnect": ") -> None",
    },
}


@dataclass
class UrScript:
    """What the arm does: a state every 2 ms, each asked for twice, then silence for a reason."""

    states: list[SimpleNamespace]
    offset: list[float] = field(default_factory=lambda: [0.0] * 6)  # of the TCP on the flange
    is_cb3: bool = False
    connected: bool = True  # after the last state
    protective_stop: bool = False
    emergency_stop: bool = False
    torn: bool = False  # a new state arrives while one is read
    refused: str | None = None
    fails: str | None = None  # a command that is not carried out
    calls: list[str] = field(default_factory=list)
    asked: list[tuple[Any, ...]] = field(default_factory=list)


def state(t: float, **fields: Any) -> SimpleNamespace:
    """wrench: of the environment on the robot, about the TCP, base frame."""
    reported = {"q": [0.0] * 6, "pose": [0.4, 0.1, 0.2, 0.0, 0.0, 0.0], "wrench": [0.0] * 6, "status": 3}
    return SimpleNamespace(t=t, **{**reported, **fields})


def fake_ur(script: UrScript) -> dict[str, ModuleType]:
    receiving: Any = ModuleType("rtde_receive")
    controlling: Any = ModuleType("rtde_control")
    receiving.RTDEReceiveInterface = partial(Receive, script)
    controlling.RTDEControlInterface = partial(FakeControlInterface, script)
    return {"rtde_receive": receiving, "rtde_control": controlling}


class Receive:
    def __init__(self, script: UrScript, hostname: str, frequency: float, variables: list[str]) -> None:
        script.asked.append(("receive", hostname, frequency, tuple(variables)))
        if script.refused is not None:
            raise RuntimeError(script.refused)
        self._script = script
        self._at = 0
        self._reads = 0

    @property
    def _now(self) -> SimpleNamespace:
        return self._script.states[min(self._at, len(self._script.states) - 1)]

    @property
    def _over(self) -> bool:
        return self._at >= len(self._script.states)

    def getTimestamp(self) -> float:  # noqa: N802 - ur_rtde's
        self._reads += 1
        if self._script.torn and self._reads % 4 == 2:
            self._at += 1
        return self._now.t

    def getActualQ(self) -> list[float]:  # noqa: N802
        return self._now.q

    def getActualTCPPose(self) -> list[float]:  # noqa: N802
        return self._now.pose

    def getActualTCPForce(self) -> list[float]:  # noqa: N802
        now = self._now
        if self._script.is_cb3:
            return now.wrench
        effector = pose_of_rotation_vector(now.pose)
        flange = flange_of(effector, pose_of_rotation_vector(self._script.offset))
        return moved_wrench(now.wrench, effector.position, flange.position)

    def getRobotStatus(self) -> int:  # noqa: N802
        return self._now.status

    def isConnected(self) -> bool:  # noqa: N802
        return self._script.connected or not self._over

    def isProtectiveStopped(self) -> bool:  # noqa: N802
        return self._script.protective_stop and self._over

    def isEmergencyStopped(self) -> bool:  # noqa: N802
        return self._script.emergency_stop and self._over

    def initPeriod(self) -> float:  # noqa: N802
        return 0.0

    def waitPeriod(self, period: float) -> None:  # noqa: N802
        self._at += 1

    def disconnect(self) -> None:
        self._script.calls.append("receive.disconnect")


class FakeControlInterface:
    def __init__(self, script: UrScript, hostname: str) -> None:
        script.asked.append(("control", hostname))
        self._script = script

    def getTCPOffset(self) -> list[float]:  # noqa: N802
        return self._script.offset

    def __getattr__(self, name: str) -> Any:
        if name not in SIGNATURES[CONTROL]:
            raise AttributeError(name)
        return lambda: self._script.calls.append(name) or name != self._script.fails
