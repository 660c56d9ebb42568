"""URScript without a controller: a script becomes Python, and runs against functions of the script manual.

URScript's blocks end with `end`; apart from that, and from poses (`p[...]`), threads and scopes, the
statements that a script here has are Python's. A thread that moves runs at once and whole; one that watches
looks once after each movement. A table lies at a height: below it 8 N are felt.

The force is as the Script Directory of the e-Series states it: of the tool's and the part's weight the stated
payload's is taken off, and "the force torque measurements are automatically zeroed when setting the payload"
(set_payload), as zero_ftsensor does. So a part that still lies where it is gripped, when its weight is
stated, is felt once it hangs.
"""

from __future__ import annotations

import inspect
import math
import re
import textwrap
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import greenlet
import numpy as np

FRAME_S = 0.01
PUSHED_M_PER_S = 0.03
TOUCHES_M = 1e-6
GRAVITY_M_PER_S2 = 9.82
LIES_M = 0.002  # below which a part that was gripped still lies on what it stood on
TOOL_KG = 0.9
BLOCK = re.compile(r"^(def|thread|if|elif|else|while)\b.*:$")


class Halted(Exception):  # noqa: N818 - URScript's word
    """The script has stopped itself."""


class FrameOver(Exception):  # noqa: N818
    """A thread that watches has looked for one frame."""


def as_python(script: str) -> str:
    """The statements of the one program of a script."""
    lines, depth = [], 0
    for text in script.splitlines():
        line = text.partition("#")[0].strip()
        if not line:
            continue
        if line == "end" or line.startswith(("elif", "else")):
            depth -= 1
            if line == "end":
                continue
        opens = BLOCK.match(line) is not None
        lines.append("    " * depth + _statement(line))
        depth += opens
    if depth:
        raise SyntaxError(f"{depth} blocks have no end")
    return "\n".join(lines)


def _statement(line: str) -> str:
    line = re.sub(r"\bp\[", "P[", line)
    line = re.sub(r"^thread\b", "def", line)
    line = re.sub(r"\brun (\w+)\(\)", r"run(\1)", line)
    line = re.sub(r"^kill (\w+)$", r"kill(\1)", line)
    line = re.sub(r"^local ", "", line)
    line = re.sub(r"^global (\w+) =", r"globals()['\1'] =", line)
    return "halt()" if line == "halt" else line


def _as_text(value: object) -> str:
    return f"{value:.6f}".rstrip("0").rstrip(".") if isinstance(value, float) else str(value)


class _Pose:
    def __getitem__(self, values: tuple[float, ...]) -> list[float]:
        assert len(values) == 6
        return [float(value) for value in values]


class Controller:
    """The functions that a script may call, with the manual's parameters; keeps what was called."""

    def __init__(self, table_m: float = -9.0, grasped: int = 2, part_kg: float = 0.0) -> None:
        self.calls: list[tuple[str, dict[str, Any]]] = []
        self.pose = [0.3, -0.3, 0.4, 0.0, 3.14, 0.0]
        self.table_m = table_m
        self.grasped = grasped
        self.pressed_n = 0.0
        self.part_kg, self.payload_kg, self.zero_n = part_kg, TOOL_KG, 0.0
        self.lies_at_m: float | None = None  # of a part in the fingers
        self._watching: Callable[[], None] | None = None
        self._looks = False
        self.variables: dict[str, int] = {"OBJ": 3, "STA": 3}

    def play(self, script: str) -> list[tuple[str, dict[str, Any]]]:
        """Run the one program of a script; what it defines are globals here, so that all of it sees it."""
        names = {
            name: self._noted(name, function)
            for name, function in inspect.getmembers(self, inspect.ismethod)
            if name not in {"play", "named"} and not name.startswith("_")
        }
        program: dict[str, Any] = {**names, "P": _Pose(), "halt": self._halt, "run": self._start}
        first, _, body = as_python(script).partition("\n")
        assert first == "def caesura_program():"
        exec(compile(textwrap.dedent(body), "script", "exec"), program)
        return self.calls

    def named(self, *names: str) -> list[dict[str, Any]]:
        return [arguments for name, arguments in self.calls if name in names]

    def _noted(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        signature = inspect.signature(function)

        def call(*values: Any, **stated: Any) -> Any:
            bound = signature.bind(*values, **stated)
            bound.apply_defaults()
            self.calls.append((name, dict(bound.arguments)))
            return function(*values, **stated)

        return call

    def _halt(self) -> None:
        raise Halted

    def _start(self, thread: Callable[[], None]) -> None:
        if thread.__name__ != "watch_force":
            thread()
        else:
            self._watching = thread

    def _moved(self, pose: list[float]) -> None:
        """Be somewhere; a thread that watches looks for one frame."""
        self.pose = list(pose)
        if self._watching is not None:
            self._looks = True
            with suppress(FrameOver):
                self._watching()
            self._looks = False

    def _measured_n(self) -> float:
        """Along z: a contact, and the weight of tool and part less the stated payload's."""
        hangs = self.lies_at_m is not None and self.pose[2] > self.lies_at_m + LIES_M
        touched_n = 8.0 if self.pose[2] < self.table_m else 0.0
        return touched_n + GRAVITY_M_PER_S2 * (self.payload_kg - TOOL_KG - self.part_kg * hangs)

    # --- Motion

    def movej(self, q: list[float], a: float = 1.4, v: float = 1.05, t: float = 0, r: float = 0) -> None:
        self._moved(q)

    def movel(self, pose: list[float], a: float = 1.2, v: float = 0.25, t: float = 0, r: float = 0) -> None:
        self._moved(pose)

    def movep(self, pose: list[float], a: float = 1.2, v: float = 0.25, r: float = 0) -> None:
        self._moved(pose)

    def speedl(self, xd: list[float], a: float, t: float) -> None:
        self.pose = [p + t * v for p, v in zip(self.pose, xd, strict=True)]

    def stopl(self, a: float) -> None: ...

    def force_mode(
        self, frame: list[float], selection: list[int], wrench: list[float], kind: int, limits: list[float]
    ) -> None:
        assert len(frame) == len(selection) == len(wrench) == len(limits) == 6
        self.pressed_n = wrench[2]

    def end_force_mode(self) -> None: ...

    def get_inverse_kin(self, pose: list[float], near: list[float]) -> list[float]:
        return pose

    def get_actual_joint_positions(self) -> list[float]:
        return [0.0] * 6

    def get_actual_tcp_pose(self) -> list[float]:
        return list(self.pose)

    def get_tcp_force(self) -> list[float]:
        return [0.0, 0.0, self._measured_n() - self.zero_n, 0.0, 0.0, 0.0]

    def zero_ftsensor(self) -> None:
        self.zero_n = self._measured_n()

    # --- The rest

    def set_tcp(self, pose: list[float]) -> None: ...

    def set_payload(self, m: float, cog: list[float]) -> None:
        self.payload_kg = m
        self.zero_n = self._measured_n()

    def get_target_payload(self) -> float:
        return TOOL_KG

    def get_target_payload_cog(self) -> list[float]:
        return [0.0, 0.0, 0.05]

    def get_tcp_offset(self) -> list[float]:
        return [0.01, 0.0, 0.16, 0.0, 0.0, 0.0]

    def norm(self, values: list[float]) -> float:
        return math.hypot(*values)

    def point_dist(self, one: list[float], other: list[float]) -> float:
        return float(np.linalg.norm(np.array(one[:3]) - other[:3]))

    def sleep(self, t: float) -> None: ...

    def sync(self) -> None:
        if self._looks:
            raise FrameOver

    def str_cat(self, op1: object, op2: object) -> str:
        return _as_text(op1) + _as_text(op2)

    def textmsg(self, s1: str, s2: object = "") -> None: ...

    def popup(
        self, s: str, title: str = "", warning: bool = False, error: bool = False, blocking: bool = False
    ) -> None: ...

    def set_standard_digital_out(self, n: int, b: bool) -> None: ...

    def socket_open(self, address: str, port: int, socket_name: str = "socket_0") -> bool:
        return True

    def socket_set_var(self, name: str, value: int, socket_name: str = "socket_0") -> None:
        self.variables[name] = value
        if name == "POS":
            self.variables["OBJ"] = self.grasped if value > 50 else 3
            self.lies_at_m = self.pose[2] if value > 50 else None

    def socket_get_var(self, name: str, socket_name: str = "socket_0") -> int:
        return self.variables[name]

    def socket_read_byte_list(self, count: int, socket_name: str = "socket_0") -> list[int]:
        return [3, 97, 99, 107]

    def kill(self, thread: object) -> None: ...


class MovingController(Controller):
    """Movements of a thread, and what force mode pushes along -z meanwhile, take their time.

    surface_m: the height of what is pressed on, at x and y [m]; what is met on the way to it: an obstacle.
    """

    def __init__(self, surface_m: Callable[[float, float], float], **world: Any) -> None:
        super().__init__(**world)
        self.surface_m = surface_m
        self._moves: greenlet.greenlet | None = None
        self._is_pushing = False

    def get_tcp_force(self) -> list[float]:
        x, y, z = self.pose[:3]
        felt = self.surface_m(x, y) + TOUCHES_M >= z
        return [0.0, 0.0, (self.pressed_n if self._is_pushing else 8.0) if felt else 0.0, 0.0, 0.0, 0.0]

    def force_mode(
        self, frame: list[float], selection: list[int], wrench: list[float], kind: int, limits: list[float]
    ) -> None:
        super().force_mode(frame, selection, wrench, kind, limits)
        self._is_pushing = True

    def end_force_mode(self) -> None:
        self._is_pushing = False

    def movel(self, pose: list[float], a: float = 1.2, v: float = 0.25, t: float = 0, r: float = 0) -> None:
        self._move(pose, v)

    def movep(self, pose: list[float], a: float = 1.2, v: float = 0.25, r: float = 0) -> None:
        self._move(pose, v)

    def sync(self) -> None:
        self._pass(FRAME_S)

    def sleep(self, t: float) -> None:
        for _ in range(round(t / FRAME_S)):
            self._pass(FRAME_S)

    def kill(self, thread: object) -> None:
        self._moves = None

    def _start(self, thread: Callable[[], None]) -> None:
        if thread.__name__ != "watch_force":
            self._moves = greenlet.greenlet(thread)

    def _move(self, pose: list[float], v: float) -> None:
        while math.dist(self.pose[: 2 + (not self._is_pushing)], pose[: 2 + (not self._is_pushing)]) > 1e-9:
            way = np.subtract(pose, self.pose)
            way[2] *= not self._is_pushing
            share = min(1.0, v * FRAME_S / float(np.linalg.norm(way[:3])))
            self.pose = [p + share * w for p, w in zip(self.pose, way.tolist(), strict=True)]
            if self._moves is not None and greenlet.getcurrent() is self._moves:
                self._moves.parent.switch()

    def _pass(self, seconds: float) -> None:
        """Let some time go by."""
        if self._is_pushing:
            x, y, z = self.pose[:3]
            self.pose[2] = max(z - PUSHED_M_PER_S * seconds, self.surface_m(x, y))
        if self._moves is not None and not self._moves.dead:
            self._moves.switch()
