"""Types of message fields with their valid values, and the columns of a sample matrix."""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal, TypeVar, get_args

from pydantic import AfterValidator, BeforeValidator, Field

from caesura_protocol.errors import MAX_LISTED, ErrorCode
from caesura_protocol.keys import NAME_PATTERN
from caesura_protocol.messages.limits import LEAST_SPEED, MAX_COLUMNS, MAX_STATUS_TEXT, MOST_SPEED
from caesura_protocol.up_direction import checked_up

LengthUnit = Literal["m", "cm", "mm"]
Quantity = Literal["time", "length", "angle", "force"]
Assumption = Literal["quaternion_order", "force_frame"]  # of what a recording leaves open
ForceFrame = Literal["base", "flange"]
WrenchSource = Literal["flange_sensor", "flange_sensor_with_hand", "joint_torque_estimate", "none"]
HandOnRobot = Literal["yes", "no", "unknown"]  # does a person guide this robot by hand?
Kind = Literal["motion", "contact", "transport", "steady", "hold", "sliding", "turning"]
Motion = Literal["motion", "steady"]
Contact = Literal["free", "contact", "transport"]
PhaseKind = Literal["free", "contact", "transport", "cycle"]  # cycle: free, and back where it began
Certainty = Literal["provisional", "final"]
HintKind = Literal[
    "hand_in_wrench",
    "unexplained_force",
    "uncertain_boundary",
    "too_fast",
    "singularity",
    "joint_limit",
    "bias_drift",
    "frozen_force",
    "show_again",
]
BridgeState = Literal[
    "ready",  # waits for a start
    "starting",
    "teaching",
    "stopping",  # the samples have ended; the service does not have all of them yet
    "failed",  # the source is lost, and is tried again
]

LENGTH_UNITS: tuple[LengthUnit, ...] = get_args(LengthUnit)
ASSUMPTIONS: tuple[Assumption, ...] = get_args(Assumption)
FORCE_FRAMES: tuple[ForceFrame, ...] = get_args(ForceFrame)
WRENCH_SOURCES: tuple[WrenchSource, ...] = get_args(WrenchSource)
ESTIMATE: WrenchSource = "joint_torque_estimate"  # of a robot without a sensor
HANDS_ON_ROBOT: tuple[HandOnRobot, ...] = get_args(HandOnRobot)

# The columns of a sample matrix, signal by signal. Time offsets (`t`) come first in every batch.
JOINTS = 7  # of a Panda
JOINTS_MOST = 8  # of any arm: a session has as many columns of `q` and `tau` as its robot has joints
COLUMNS_OF_SIGNAL: dict[str, tuple[str, ...]] = {
    "pos": ("px", "py", "pz"),
    "quat": ("qx", "qy", "qz", "qw"),
    "q": tuple(f"q{i}" for i in range(1, JOINTS_MOST + 1)),
    "force": ("fx", "fy", "fz"),
    "torque": ("mx", "my", "mz"),
    "tau": tuple(f"tau{i}" for i in range(1, JOINTS_MOST + 1)),
    "gripper": ("gripper",),
}

Name = Annotated[str, Field(pattern=NAME_PATTERN)]
Count = Annotated[int, Field(ge=0, lt=1 << 53)]
Seconds = Annotated[float, Field(allow_inf_nan=False)]
Probability = Annotated[float, Field(ge=0.0, le=1.0)]
Amount = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Newtons = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
ForceLimit = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]  # [N]
Tolerance = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]  # [m] or [rad]
MAX_TAG = 64  # characters of the `do` of an action
_UNSEEN = r"\u0000-\u001f\u007f-\u009f\u00ad\u061c\u180e\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff"
# A joiner (U+200C, U+200D) belongs to words of Persian and Indic scripts, and to emoji of several people. It
# stands between two characters that are no spaces, one of them from U+0600 on, or after a virama of an Indic
# script. Elsewhere two names would differ unseen.
_JOINER = r"[\u200c\u200d]"
_SPACES = r"\u0020\u00a0\u1680\u2000-\u200a\u202f\u205f\u3000"
_VIRAMA = r"\u094d\u09cd\u0a4d\u0acd\u0b4d\u0bcd\u0c4d\u0ccd\u0d4d\u0dca"
_JOINING = rf"[^\u0000-\u05ff{_UNSEEN}{_SPACES}{_VIRAMA}]"
_BEFORE = rf"(?:[!-~]{_JOINER})?"  # ASCII may be joined to what follows
# Characters that joiners hold together, or a single one. Each text is divided in one way at most, so that no
# engine tries many.
SEEN = (
    rf"{_BEFORE}(?:{_JOINING}{_JOINER}{_BEFORE})*"
    rf"(?:{_JOINING}{_JOINER}[!-~\u00a1-\u00ac\u00ae-\u05ff]|[{_VIRAMA}]{_JOINER}?|{_JOINING})"
    rf"|[^{_UNSEEN}]"
)
LINE = f"^({SEEN})+$"
Author = Annotated[str, Field(min_length=1, max_length=64, pattern=LINE)]
TaskName = Annotated[str, Field(min_length=1, max_length=120, pattern=LINE)]
Note = Annotated[str, Field(min_length=1, max_length=1000, pattern=LINE)]
Tag = Annotated[str, Field(min_length=1, max_length=64, pattern=LINE)]
HintText = Annotated[str, Field(min_length=1, max_length=200, pattern=LINE)]
PhaseName = Annotated[str, Field(min_length=1, max_length=64, pattern=LINE)]  # and of a group of apps
AppLabel = Annotated[str, Field(min_length=1, max_length=64, pattern=LINE)]
StatusText = Annotated[str, Field(min_length=1, max_length=MAX_STATUS_TEXT, pattern=LINE)]
SpeedFactor = Annotated[float, Field(ge=LEAST_SPEED, le=MOST_SPEED)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
AppField = Literal[
    "name", "note", "target", "target_name", "speed", "force_n", "tolerance_m", "gripper_width"
]
DescriptionField = Literal["task", "operator", "note", "tags", "success", "deleted"]
ChangedField = AppField | Literal["place", "added", "taught_again"]
EditState = Literal["applied", "not_applied", "undone"]  # of a correction, or of an edit of a program
T = TypeVar("T")
Listed = Annotated[tuple[T, ...], Field(fail_fast=True)]  # of a million errors the first says enough
Counted = Annotated[dict[ErrorCode, Count], Field(fail_fast=True)]
Assumptions = Annotated[Listed[Assumption], Field(max_length=len(ASSUMPTIONS))]
Columns = Annotated[Listed[str], Field(min_length=2, max_length=MAX_COLUMNS)]
Vector = tuple[float, float, float]
FiniteVector = tuple[Finite, Finite, Finite]
Up = Annotated[FiniteVector, AfterValidator(checked_up)]  # away from gravity, base frame, length 1
Quaternion = tuple[float, float, float, float]
Joints = Annotated[Listed[float], Field(min_length=1, max_length=JOINTS_MOST)]  # base to flange
Scalar = bool | int | float | str | None
Inferred = Scalar | Annotated[Listed[Scalar], Field(max_length=MAX_LISTED)]  # value of an app
Shown = Scalar | Listed[Scalar]  # of a value that was refused


def _with_short_tag(value: Any) -> Any:
    """Return the value. Raises ValueError for a `do` that is no short text: pydantic prints all of it."""
    if isinstance(value, dict) and not (isinstance(do := value.get("do"), str) and len(do) <= MAX_TAG):
        raise ValueError("do is no short text")
    return value


ShortTag = BeforeValidator(_with_short_tag)  # of an action within a result, which may be long


def as_line(text: str) -> str:
    """Return a text with a space in place of each character that LINE refuses."""
    return re.sub(rf"({SEEN})|[\s\S]", lambda one: one[1] or " ", text)
