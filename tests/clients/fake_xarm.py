"""xarm-python-sdk without a robot: the calls that source and script make, with their parameters.

Parameters are those of xArm-Python-SDK 1.18.4; `test_xarm.py` compares them with the package.

What UFACTORY states, and this arm does: a report of the type "real" (TCP port 30003) has state and mode, and
no error code (ufactory_docs, "Data Description of TCP port"): what the SDK hands on as `error_code` is what
was asked for last. State 4 is STOP, to which the arm "will automatically switch when any error occurs" (user
manual of UFACTORY Studio, 10.2). "Mode 2 must be configured via Mode 0. If the current mode is a non-zero
value, an attempt to set Mode 2 will first trigger an automatic switch to Mode 0" (10.1).
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from functools import partial
from types import ModuleType
from typing import Any

PARAMETERS = {
    "register_report_callback": ["callback"],
    "set_ft_sensor_enable": ["on_off"],
    "set_ft_sensor_zero": [],
    "motion_enable": ["enable"],
    "get_err_warn_code": [],
    "set_mode": ["mode"],
    "set_state": ["state"],
    "disconnect": [],
}


READY, STOP = 2, 4  # states


@dataclass
class XArmScript:
    """What the arm reports, then silence for a reason. A report's mode is not in what the callback gets."""

    reports: list[dict[str, Any]]
    force: list[float] = field(default_factory=lambda: [0.0] * 6)
    connected: bool = True  # after the last report
    refused: str | None = None
    codes: dict[str, int] = field(default_factory=dict)
    mode: int = 0  # in which the arm is found
    error: int = 0  # of the controller, once it is stopped
    calls: list[tuple[Any, ...]] = field(default_factory=list)


def report(**fields: Any) -> dict[str, Any]:
    return {
        "cartesian": [400.0, 0.0, 200.0, 0.0, 0.0, 0.0],
        "joints": [0.0] * 7,
        "state": READY,
        "mode": 0,
    } | fields


def fake_xarm(script: XArmScript) -> dict[str, ModuleType]:
    wrapper: Any = ModuleType("xarm.wrapper")
    wrapper.XArmAPI = partial(XArmAPI, script)
    package: Any = ModuleType("xarm")
    package.wrapper = wrapper
    return {"xarm": package, "xarm.wrapper": wrapper}


class XArmAPI:
    def __init__(self, script: XArmScript, port: str, is_radian: bool, report_type: str) -> None:
        script.calls.append(("XArmAPI", port, is_radian, report_type))
        if script.refused is not None:
            raise RuntimeError(script.refused)
        self._script = script
        self.mode = script.mode

    @property
    def ft_ext_force(self) -> list[float]:
        return self._script.force

    @property
    def connected(self) -> bool:
        return self._script.connected

    def register_report_callback(self, callback: Any) -> bool:
        thread = threading.Thread(target=self._report, args=(callback,))
        thread.start()
        thread.join()
        return True

    def _report(self, callback: Any) -> None:
        for one in self._script.reports:
            self.mode = one["mode"]
            callback({name: value for name, value in one.items() if name != "mode"} | {"error_code": 0})

    def set_mode(self, mode: int) -> int:
        self._script.calls.append(("set_mode", mode))
        self.mode = mode if mode != 2 or self.mode == 0 else 0
        return self._script.codes.get("set_mode", 0)

    def get_err_warn_code(self) -> tuple[int, list[int]]:
        return self._script.codes.get("get_err_warn_code", 0), [self._script.error, 0]

    def __getattr__(self, name: str) -> Any:
        if name not in PARAMETERS:
            raise AttributeError(name)

        def call(*values: Any) -> int:
            assert len(values) <= len(PARAMETERS[name])
            self._script.calls.append((name, *values))
            return self._script.codes.get(name, 0)

        return call
