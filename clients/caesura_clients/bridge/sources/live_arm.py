"""A live arm as a source: reads its states and its gripper, and commands nothing.

A vendor's module supplies a function that waits for the next state (`ArmState`), with the vendor's signs,
units and frames already converted. A gripper is polled in a separate thread: its answers are slower than the
arm's, and may block. While its width is unknown, no state becomes a sample: every value on the wire is
finite, so the session states the missing time as a gap.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from caesura_clients.bridge.sources import Chunk
from caesura_protocol.columns import columns_of
from caesura_protocol.errors import SourceError
from caesura_protocol.flange_pose import Quaternion, Transform, nearest
from caesura_protocol.messages import ForceFrame, HandOnRobot, LengthUnit, WrenchSource

logger = logging.getLogger(__name__)

SIGNALS = ("pos", "quat", "q")
WRENCH = ("force", "torque")
CHUNK_MS = 20  # of the robot's time
GRIPPER_S = 0.02  # between two questions
GRIPPER_TIMEOUT_S = 3.0
MS = 1000
NO_GRIPPER = " (without a gripper: --no-gripper)"


class ArmState(NamedTuple):
    """One state of an arm, in the wire's units and signs.

    wrench: (6,) [N, Nm] of the environment on the robot, about the flange, empty if none is measured; tau:
    (joints,) [Nm], empty if none is measured; button_pressed: state of the hand-guiding button.
    """

    t: float  # [s] of the robot's clock
    q: Sequence[float]  # [rad]
    flange: Transform  # in the base frame
    wrench: Sequence[float]
    tau: Sequence[float] = ()
    button_pressed: bool = False


class Gripper(Protocol):
    """A gripper whose opening a separate thread reads."""

    @property
    def width(self) -> float | None:
        """The newest opening [m]; None while it is unknown."""

    @property
    def failure(self) -> str | None:
        """The reason why the gripper is permanently lost; None while it is not."""

    def close(self) -> None:
        """Stop reading the gripper."""


class LiveArm:
    """A live arm as a Source.

    who: name of the arm in errors; read: waits for the next state; joints: number of joints; torques: whether
    a state has `tau`; button: whether a state has `button_pressed`; gripper: is read in its own thread;
    width: returns the opening [m] of a gripper without a thread, and may block; both None: no gripper; over:
    called at the end. `chunks` raises SourceError with the reason if the arm or its gripper is lost.
    """

    length_unit: LengthUnit = "m"
    can_wait = False

    def __init__(
        self,
        who: str,
        read: Callable[[], ArmState],
        joints: int,
        *,
        wrench_source: WrenchSource,
        hand_on_robot: HandOnRobot,
        torques: bool = False,
        button: bool = False,
        force_frame: ForceFrame = "base",
        gripper: Gripper | None = None,
        width: Callable[[], float] | None = None,
        over: Callable[[], None] | None = None,
    ) -> None:
        self.wrench_source: WrenchSource = wrench_source
        self.hand_on_robot: HandOnRobot = hand_on_robot
        self.force_frame: ForceFrame = force_frame
        measured = WRENCH if wrench_source != "none" else ()
        has_gripper = gripper is not None or width is not None
        signals = (*SIGNALS, *measured, *(["tau"] if torques else []), *(["gripper"] if has_gripper else []))
        self.columns = columns_of(signals, joints)
        self.button_pressed = False if button else None  # as of the newest chunk
        self._who = who
        self._read = read
        self._over = over
        self._gripper = gripper
        if width is not None:
            self._gripper = connect_arm(f"{who}, its gripper", lambda: _AskedGripper(width), NO_GRIPPER)

    def chunks(self) -> Iterator[Chunk]:
        """Yield about 20 ms of states at a time; a state that is read twice is yielded once."""
        rows: list[list[float]] = []
        first: float | None = None
        last = 0.0
        orientation = (0.0, 0.0, 0.0, 1.0)
        try:
            while True:
                try:
                    state = self._next(0.0 if first is None else last - first)
                except SourceError:
                    if rows:
                        yield np.array(rows)
                    raise
                if first is not None and state.t == last:
                    continue
                first = state.t if first is None else first
                last = state.t
                if self.button_pressed is not None:
                    self.button_pressed = state.button_pressed
                widths = self._widths()
                if widths is None:
                    if rows:
                        yield np.array(rows)
                        rows = []
                    continue
                row = self._row(state, first, orientation, widths)
                orientation = (row[4], row[5], row[6], row[7])
                rows.append(row)
                if round(MS * (row[0] - rows[0][0])) >= CHUNK_MS - 1:
                    yield np.array(rows)
                    rows = []
        finally:
            self.close()

    def close(self) -> None:
        """Stop reading the gripper, then end the connection to the arm.

        A vendor's thread that runs at the interpreter's exit can crash the process.
        """
        if self._gripper is not None:
            self._gripper.close()
        over, self._over = self._over, None
        try:
            if over is not None:
                over()
        except Exception as error:  # an arm that is lost takes no command, and why it was lost counts
            logger.warning("%s: it could not be ended in order: %s", self._who, _error_text(error))

    def _next(self, after_s: float) -> ArmState:
        if self._gripper is not None and self._gripper.failure is not None:
            raise SourceError(
                f"{self._who}: the gripper was lost after {after_s:.1f} s: {self._gripper.failure}"
            )
        try:
            return self._read()
        except Exception as error:  # whatever the vendor's package makes of it
            raise SourceError(f"{self._who}: lost after {after_s:.1f} s: {_error_text(error)}") from error

    def _widths(self) -> tuple[float, ...] | None:
        """Return the gripper's column: its width [m]; empty without a gripper, None while it is unknown."""
        if self._gripper is None:
            return ()
        width = self._gripper.width
        return None if width is None else (width,)

    def _row(
        self, state: ArmState, first: float, orientation: Quaternion, widths: tuple[float, ...]
    ) -> list[float]:
        return [
            round(state.t - first, 6),
            *state.flange.position,
            *nearest(state.flange.orientation, orientation),
            *map(float, state.q),
            *(state.wrench if self.wrench_source != "none" else ()),
            *state.tau,
            *widths,
        ]


class _AskedGripper:
    """A gripper whose width is polled in a thread until `close`. ask: returns the opening [m]."""

    def __init__(self, ask: Callable[[], float]) -> None:
        self.width: float | None = ask()
        self.failure: str | None = None
        self._over = threading.Event()
        self._ask = ask
        self._thread = threading.Thread(target=self._run, name="gripper", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the polling, and wait for the last answer, at most GRIPPER_TIMEOUT_S.

        The vendor's package itself gives up in time.
        """
        self._over.set()
        self._thread.join(GRIPPER_TIMEOUT_S)

    def _run(self) -> None:
        try:
            while not self._over.wait(GRIPPER_S):
                self.width = self._ask()
        except Exception as error:
            self.failure = _error_text(error)


def connect_arm(name: str, connect: Callable[[], Any], hint: str = "") -> Any:
    """Return the result of `connect`. Raises SourceError with its reason, and `hint`, if it fails."""
    try:
        return connect()
    except Exception as error:
        raise SourceError(f"{name}: cannot connect: {_error_text(error)}{hint}") from error


def _error_text(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
