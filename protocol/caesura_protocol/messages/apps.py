"""The apps of a task program, and their paths."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from caesura_protocol.app_kinds import AppKind
from caesura_protocol.messages.field_types import (
    Amount,
    AppLabel,
    Author,
    ChangedField,
    Count,
    Inferred,
    Joints,
    Listed,
    Newtons,
    Note,
    Probability,
    Quaternion,
    Seconds,
    SpeedFactor,
    Vector,
)
from caesura_protocol.messages.limits import MAX_VIA_POINTS
from caesura_protocol.messages.message import Message
from caesura_protocol.messages.results import ScrewMotion


class ViaPoint(Message):
    """A pose of the flange on an app's path, base frame."""

    t: Seconds  # [s]
    position: Vector  # [m]
    orientation: Quaternion | None  # x y z w
    velocity: Vector | None = None  # [m/s] with which it was passed; None for a start at rest
    angular_velocity: Vector | None = None  # [rad/s] likewise; None where no orientation is known


class AppPath(Message):
    """The taught path from the start of an app to its target.

    The reproduced path leads through its start, the via points and the app's target. The curve between them
    is that of `caesura_protocol.reproduced_path`; without a via point it is the straight line.
    """

    start: ViaPoint  # where the demonstration was; the robot may begin elsewhere
    via: Annotated[Listed[ViaPoint], Field(max_length=MAX_VIA_POINTS)] = ()
    tn: Seconds  # [s] at the target
    end_velocity: Vector | None = None  # [m/s] there, on into the next app; None: it rests
    end_angular_velocity: Vector | None = None  # [rad/s] likewise
    length_m: float  # of the demonstrated path
    deviation_m: float  # largest distance from the demonstrated path to the reproduced one
    deviation_rad: float  # largest angle between the two, 0 where no orientation is known
    tolerance_m: float  # that was asked for
    tolerance_rad: float


class AppChange(Message):
    """A field of an app that an operator has set."""

    field: ChangedField
    author: Author
    edit: Count  # its number
    inferred: Inferred = None  # the value without edits; of a force its size [N]


class RestForce(Message):
    """Force of a stroke while it rests: before its path begins, or after it has ended."""

    newton: Newtons  # after the limit
    newton_taught: Newtons  # before the limit


class App(Message):
    """One step of a task program, with the edits that apply to it."""

    kind: AppKind
    t0: Seconds
    tn: Seconds
    target: Vector | None  # [m] base frame
    orientation: Quaternion | None  # x y z w
    joints: Joints | None  # [rad]
    force: Vector | None  # [N] what the robot exerts, after the limit
    force_taught: Vector | None  # [N] what was taught, before the limit
    load_kg: float | None
    load_sd_kg: float | None
    gripper_width: float | None  # [m]
    confidence: Probability
    segments: Listed[Count]  # indices of the segments that it came from
    path: AppPath | None = None  # None: an app that does not move, or whose movement goes on
    screw: ScrewMotion | None = None  # of a turn: its torque is what the robot exerts
    rest_before: RestForce | None = None  # in contact until the path begins; None: as hard as `force`
    rest_after: RestForce | None = None  # in contact after the path; None: as hard as `force`
    name: AppLabel | None = None
    note: Note | None = None
    speed: SpeedFactor | None = None  # a factor of the taught speed; None: as taught
    added: Count | None = None  # the number of the edit that added it; None: it was taught
    changes: Annotated[Listed[AppChange], Field(max_length=11)] = ()  # what people set, a field once
    target_name: AppLabel | None = None  # what people call its target
    off_straight_m: Amount | None = None  # of a press without a path: off the way to its target
    weaker_n: Amount | None = None  # [N] of a press: another force, held or not exceeded for a part of it
    aslant: Vector | None = None  # [N] of a press: what the robot would exert for 0.5 s in another direction
    moved_m_per_s: Amount | None = None  # of fingers that acted in motion: speed of the flange then
    turned_rad_per_s: Amount | None = None  # likewise: its rate of turn
    stronger_n: Amount | None = None  # [N] of a press: the largest held for 0.2 s, if it is another one
    impact_n: Amount | None = None  # [N] of a press: a larger force that was shorter, as at a touch
