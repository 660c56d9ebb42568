"""A Franka arm through any wrapper of libfranka: its state, up to 1 kHz, read and never commanded.

What is read, in libfranka's words (franka::RobotState, robot_state.h):
  q [rad]; O_T_EE and F_T_EE, 4×4 in column-major order, from which the flange's pose is taken;
  O_F_ext_hat_K [N, Nm] in the base frame, at the stiffness frame K: "forces applied by the robot to the
  environment are positive", so it is negated; zeros near a singularity;
  tau_ext_hat_filtered [Nm], of the same sign;  time, in milliseconds since the robot was started.
A gripper is asked in a thread of its own: its answers come slower than the arm's, and may wait.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from caesura_clients.bridge.sources import Chunk
from caesura_protocol.columns import columns_of
from caesura_protocol.errors import SourceError
from caesura_protocol.formats.poses import Transform, flange_of, nearest, pose_of
from caesura_protocol.messages import JOINTS, ForceFrame, HandOnRobot, LengthUnit, WrenchSource

SIGNALS = ("pos", "quat", "q", "force", "torque", "tau")
CHUNK_MS = 20  # of the robot's time
GRIPPER_S = 0.02  # between two questions
GRIPPER_TIMEOUT_S = 3.0
MS = 1000
NO_GRIPPER = " (without a gripper: --no-gripper)"


class FrankaState(NamedTuple):
    """What is read of one state, as libfranka has it."""

    time_ms: int
    q: Sequence[float]
    effector: Transform  # O_T_EE
    effector_on_flange: Transform  # F_T_EE
    wrench: Sequence[float]  # O_F_ext_hat_K
    tau: Sequence[float]  # tau_ext_hat_filtered


def state_of(state: Any, pose: Callable[[Any], Transform] = pose_of) -> FrankaState:
    """A franka::RobotState as a wrapper shows it, in plain values; pose: reads what it has as a matrix."""
    return FrankaState(
        time_ms=int(state.time.to_msec()),
        q=state.q,
        effector=pose(state.O_T_EE),
        effector_on_flange=pose(state.F_T_EE),
        wrench=state.O_F_ext_hat_K,
        tau=state.tau_ext_hat_filtered,
    )


class FrankaSource:
    """A live arm as a Source.

    who: what errors call it; read: waits for the next state; width: the gripper's opening [m], which may
    wait; None where there is no gripper; hand_on_robot: does a person guide this arm by hand?
    Raises SourceError in `chunks` where either is lost, with the reason.
    """

    wrench_source: WrenchSource = "joint_torque_estimate"
    force_frame: ForceFrame = "base"
    length_unit: LengthUnit = "m"
    can_wait = False

    def __init__(
        self,
        name: str,
        read: Callable[[], FrankaState],
        width: Callable[[], float] | None = None,
        hand_on_robot: HandOnRobot = "yes",
    ) -> None:
        self.hand_on_robot: HandOnRobot = hand_on_robot
        signals = SIGNALS if width is None else (*SIGNALS, "gripper")
        self.columns = columns_of(signals, JOINTS)
        self._who = name
        self._read = read
        self._gripper: _Gripper | None = None
        if width is not None:
            self._gripper = connect_arm(f"{name}, its gripper", lambda: _Gripper(width), NO_GRIPPER)

    def chunks(self) -> Iterator[Chunk]:
        """Yield about 20 ms of states at a time; a state that is read twice is yielded once."""
        rows: list[list[float]] = []
        first: int | None = None
        last = 0
        orientation = (0.0, 0.0, 0.0, 1.0)
        try:
            while True:
                try:
                    state = self._next(0.0 if first is None else (last - first) / MS)
                except SourceError:
                    if rows:
                        yield np.array(rows)
                    raise
                if first is not None and state.time_ms == last:
                    continue
                first = state.time_ms if first is None else first
                last = state.time_ms
                row = self._row(state, first, orientation)
                orientation = (row[4], row[5], row[6], row[7])
                rows.append(row)
                if last - round(rows[0][0] * MS) - first >= CHUNK_MS - 1:
                    yield np.array(rows)
                    rows = []
        finally:
            self.close()

    def close(self) -> None:
        """Stop asking the gripper: a thread in libfranka at the interpreter's end takes all with it."""
        if self._gripper is not None:
            self._gripper.close()

    def _next(self, after_s: float) -> FrankaState:
        if self._gripper is not None and self._gripper.failure is not None:
            raise SourceError(
                f"{self._who}: the gripper was lost after {after_s:.1f} s: {self._gripper.failure}"
            )
        try:
            return self._read()
        except Exception as error:  # whatever the wrapper makes of libfranka's
            raise SourceError(f"{self._who}: lost after {after_s:.1f} s: {_error_text(error)}") from error

    def _row(self, state: FrankaState, first: int, orientation: Any) -> list[float]:
        flange = flange_of(state.effector, state.effector_on_flange)
        return [
            (state.time_ms - first) / MS,
            *flange.position,
            *nearest(flange.orientation, orientation),
            *map(float, state.q),
            *(-float(value) for value in state.wrench),
            *(-float(value) for value in state.tau),
            *(() if self._gripper is None else (self._gripper.width,)),
        ]


class _Gripper:
    """The gripper's last width, asked for until it is over."""

    def __init__(self, ask: Callable[[], float]) -> None:
        self.width = ask()
        self.failure: str | None = None
        self._over = threading.Event()
        self._ask = ask
        self._thread = threading.Thread(target=self._run, name="gripper", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Wait for the last answer, which libfranka itself gives up in time."""
        self._over.set()
        self._thread.join(GRIPPER_TIMEOUT_S)

    def _run(self) -> None:
        try:
            while not self._over.wait(GRIPPER_S):
                self.width = self._ask()
        except Exception as error:
            self.failure = _error_text(error)


def connect_arm(name: str, connect: Callable[[], Any], hint: str = "") -> Any:
    """What `connect` gives. Raises SourceError, with the reason, where it does not."""
    try:
        return connect()
    except Exception as error:
        raise SourceError(f"{name}: cannot connect: {_error_text(error)}{hint}") from error


def _error_text(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
