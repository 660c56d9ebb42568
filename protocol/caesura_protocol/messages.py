"""All messages on the wire, as frozen models. Each field states its shape and unit.

Samples travel as one binary matrix behind a small header: validating the header costs microseconds,
validating a thousand floats one by one would cost milliseconds. Times are seconds on the session's own
clock, positions metres in the base frame, forces newtons as the environment acts on the robot, in the
base frame. Readers ignore header fields that they do not know.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, Field

from caesura_protocol.app_kinds import AppKind
from caesura_protocol.errors import ErrorCode
from caesura_protocol.keys import NAME_PATTERN

MAX_MESSAGE_BYTES = 1 << 20
MAX_WHOLE_BYTES = 1 << 26  # of a message that goes in pieces
PIECE_BYTES = 1 << 19  # of its bytes in one of them
MAX_BATCH_SAMPLES = 1000
MAX_BATCH_SPAN_S = 60.0  # first to last sample of a batch
MAX_BATCHES_AHEAD = 1_000_000  # of the expected one; further ahead is not a sequence number
MAX_COLUMNS = 64
MAX_GAPS = 256  # that a status lists
MAX_BUDGETS = 32  # stations whose budgets a service status lists
MAX_VIA_POINTS = 64  # of the path of an app
MAX_HOLES = 2048  # that recorded samples list
MAX_TAGS = 16  # of a session
MAX_CORRECTIONS = 1000  # of a session, those that were taken back included
MAX_EFFECT_ROWS = 24  # of a kind, before and after an edit, that its effect lists
MAX_PROGRAM_EDITS = 500  # of a session, those that are undone included
MAX_PART_APPS = 100  # that one edit puts in the place of a part
MAX_TAUGHT_AGAIN = 300  # apps of a program that were taught again
MAX_TAUGHT_AGAIN_HELD = 1000  # that its edits hold, also for undo; those that are undone do not count
MAX_PART_BYTES = 1 << 19  # of the apps that one edit puts in the place of a part
LEAST_SPEED, MOST_SPEED = 0.1, 2.0  # factors of the taught speed that an app, or a program, may have
MAX_HINTS = 64  # that a message lists

LengthUnit = Literal["m", "cm", "mm"]
Quantity = Literal["time", "length", "angle", "force"]
ForceFrame = Literal["base", "flange"]
WrenchSource = Literal["flange_sensor", "flange_sensor_with_hand", "joint_torque_estimate", "none"]
HandOnRobot = Literal["yes", "no", "unknown"]  # does a person guide this robot by hand?
Kind = Literal["motion", "contact", "transport", "steady", "hold", "sliding", "turning"]
Motion = Literal["motion", "steady"]
Contact = Literal["free", "contact", "transport"]
PhaseKind = Literal["free", "contact", "transport", "cycle"]  # cycle: free, and back where it began
PhaseName = Annotated[str, Field(min_length=1, max_length=64)]  # of a phase, and of a group of apps
Certainty = Literal["provisional", "final"]
HintKind = Literal[
    "hand_in_wrench",
    "unexplained_force",
    "uncertain_boundary",
    "too_fast",
    "singularity",
    "joint_limit",
    "bias_drift",
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
UNPRINTABLE = r"\u0000-\u001f\u007f-\u009f\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff"
LINE = f"^[^{UNPRINTABLE}]+$"
Author = Annotated[str, Field(min_length=1, max_length=64, pattern=LINE)]
TaskName = Annotated[str, Field(min_length=1, max_length=120, pattern=LINE)]
Note = Annotated[str, Field(min_length=1, max_length=1000, pattern=LINE)]
Tag = Annotated[str, Field(min_length=1, max_length=64, pattern=LINE)]
HintText = Annotated[str, Field(min_length=1, max_length=200, pattern=LINE)]
AppLabel = Annotated[str, Field(min_length=1, max_length=64, pattern=LINE)]
SpeedFactor = Annotated[float, Field(ge=LEAST_SPEED, le=MOST_SPEED)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
AppField = Literal[
    "name", "note", "target", "target_name", "speed", "force_n", "tolerance_m", "gripper_width"
]
ChangedField = AppField | Literal["place", "added", "taught_again"]
EditState = Literal["applied", "not_applied", "undone"]  # of a correction, or of an edit of a program
T = TypeVar("T")
Listed = Annotated[tuple[T, ...], Field(fail_fast=True)]  # of a million errors the first says enough
Counted = Annotated[dict[ErrorCode, Count], Field(fail_fast=True)]
Columns = Annotated[Listed[str], Field(min_length=2, max_length=MAX_COLUMNS)]
Vector = tuple[float, float, float]
FiniteVector = tuple[Finite, Finite, Finite]
Quaternion = tuple[float, float, float, float]
Joints = Annotated[tuple[float, ...], Field(min_length=1, max_length=JOINTS_MOST)]  # base to flange


Scalar = bool | int | float | str | None
Shown = Scalar | Listed[Scalar]  # of a value that was refused

_NOT_ASKED: set[str] = set()


class Message(BaseModel):
    """A payload: frozen, compared by value, tolerant of fields that a newer peer adds."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    def model_post_init(self, context: Any, /) -> None:
        """Drop the set of given fields: nothing reads it, and it is half of the memory of a message."""
        object.__setattr__(self, "__pydantic_fields_set__", _NOT_ASKED)


# --- bridge to service ----------------------------------------------------------------------------------


class SampleBatch(Message):
    """Some consecutive samples of one robot.

    samples: little-endian float32 or float64 (the size determines which), matrix (n, columns), row major;
    its first column is the time offset from `t0` [s].
    """

    session: Name
    epoch: Count  # how often the bridge has (re)started this session
    seq: Count  # counts batches of the session from 0, without holes
    n: Annotated[int, Field(ge=1, le=MAX_BATCH_SAMPLES)]
    columns: Columns
    t0: Seconds  # [s] session clock
    samples: bytes
    bridge: Name | None = None  # which one sends: a session belongs to one bridge


class Heartbeat(Message):
    """Sent while nothing else is: its sequence number exposes a lost tail."""

    session: Name
    epoch: Count
    seq: Annotated[int, Field(ge=-1)]  # the last batch that was put; -1 before the first
    bridge: Name | None = None


class Description(Message):
    """What people state about a session. It changes no result."""

    task: TaskName | None = None  # the name under which it is found again
    operator: Author | None = None  # who teaches
    note: Note | None = None
    tags: Annotated[Listed[Tag], Field(max_length=MAX_TAGS)] = ()
    success: bool | None = None  # None: not stated
    deleted: bool = False  # lists leave it out; its samples stay until the journal's limits remove them


class Open(Message):
    """Command: begin a session, or say again what it is (opening twice alike is no error)."""

    type: Literal["open"] = "open"
    session: Name
    epoch: Count = 0
    columns: Columns
    wrench_source: WrenchSource | None = None  # None: not stated; the service takes the conservative reading
    hand_on_robot: HandOnRobot = "unknown"
    force_frame: ForceFrame = "base"
    length_unit: LengthUnit = "m"
    preset: Name | None = None  # None: the service's own choice
    bridge: Name | None = None  # names this bridge; another one needs a higher epoch to take the session over
    force_limit_n: ForceLimit | None = None  # of the cell: no app exerts more; None: as it was taught
    path_tolerance_m: Tolerance | None = None  # of the apps' paths; None: the service's own choice
    path_tolerance_rad: Tolerance | None = None
    robot: Name | None = None  # which arm this is; None: not stated
    declared_units: Listed[Quantity] = ()  # whose unit a person declared: implausible values are believed
    description: Description | None = None  # as it begins; `Describe` changes it


class Close(Message):
    """Command: the demonstration is over; everything up to batch `last_seq` belongs to it."""

    type: Literal["close"] = "close"
    session: Name
    last_seq: Annotated[int, Field(ge=-1)]
    bridge: Name | None = None
    success: bool | None = None  # of the demonstration; None leaves the description as it is


class Insert(Message):
    """A segment ends here and the next begins, as near to `t` as there are observations."""

    do: Literal["insert"] = "insert"
    t: Seconds  # [s]


class Remove(Message):
    """The two segments that meet in the changepoint nearest to `t` are one."""

    do: Literal["remove"] = "remove"
    t: Seconds  # [s]


class Move(Message):
    """The changepoint nearest to `t` is at `to` instead."""

    do: Literal["move"] = "move"
    t: Seconds  # [s]
    to: Seconds  # [s]


class Relabel(Message):
    """The segment in which `t` lies is one, from end to end, and of this kind."""

    do: Literal["relabel"] = "relabel"
    t: Seconds  # [s]
    kind: Kind


class LimitForce(Message):
    """The app in whose time `t` lies exerts no more than this."""

    do: Literal["limit_force"] = "limit_force"
    t: Seconds  # [s]
    newton: Newtons | None  # None: only the cell's limit


class NamePhase(Message):
    """The phase in which `t` lies is called this; its apps are a group of that name."""

    do: Literal["name_phase"] = "name_phase"
    t: Seconds  # [s]
    name: PhaseName


class Undo(Message):
    """Take the last correction back."""

    do: Literal["undo"] = "undo"


class Redo(Message):
    """Make the correction that was taken back last once more."""

    do: Literal["redo"] = "redo"


class TakeBack(Message):
    """Take one correction back; those that came after it stay."""

    do: Literal["take_back"] = "take_back"
    number: Count  # of the correction, as the program lists it


Change = Insert | Remove | Move | Relabel | LimitForce | NamePhase
Action = Annotated[
    Insert | Remove | Move | Relabel | LimitForce | NamePhase | Undo | Redo | TakeBack,
    Field(discriminator="do"),
]


class Edit(Message):
    """Command: correct what a session shows, open or closed. Refused where the revision is another."""

    type: Literal["edit"] = "edit"
    session: Name
    revision: Count  # of the session, as the editor has seen it; every edit makes it one more
    author: Author
    action: Action
    with_effect: bool = False  # requested in the Ack; an older editor reads at most 256 items of one


class Preview(Message):
    """Command: state what an edit would change. It is refused as the edit would be; nothing is changed.

    The answer is an Ack with the effect, and the revision as it is.
    """

    type: Literal["preview"] = "preview"
    session: Name
    revision: Count  # as of an edit
    action: Action


class Describe(Message):
    """Command: replace the description of a session, open or closed.

    Refused where the description is neither `before` nor `description`: another operator was first. Undo is
    the same command with the two exchanged.
    """

    type: Literal["describe"] = "describe"
    session: Name
    author: Author
    before: Description  # as the author has seen it
    description: Description


class AppReference(Message):
    """An app as an editor has seen it.

    It is the app of this kind that begins there, or else the one whose time is most nearly the same.
    """

    kind: AppKind
    t0: Seconds  # [s]
    tn: Seconds  # [s]
    added: Count | None = None  # the number of the program edit that added it; None: it was taught


class ChangeApp(Message):
    """An app has other values. A field that is None stays as it is."""

    do: Literal["change"] = "change"
    app: AppReference
    name: AppLabel | None = None
    note: Note | None = None
    target: FiniteVector | None = None  # [m] base frame; its path keeps the via points
    target_name: AppLabel | None = None  # such as "above the tray"
    speed: SpeedFactor | None = None  # a factor of the taught speed
    force_n: Newtons | None = None  # [N] in the direction that was taught
    tolerance_m: Tolerance | None = None  # that its path has to keep
    gripper_width: Amount | None = None  # [m]
    as_taught: Annotated[Listed[AppField], Field(max_length=8)] = ()  # fields that lose their edits


class MoveApp(Message):
    """An app is run at another place of the program."""

    do: Literal["move"] = "move"
    app: AppReference
    after: AppReference | None  # None: first


class DeleteApp(Message):
    """An app is left out."""

    do: Literal["delete"] = "delete"
    app: AppReference


class DuplicateApp(Message):
    """A copy of an app follows it."""

    do: Literal["duplicate"] = "duplicate"
    app: AppReference


class InsertApp(Message):
    """A new app, which was not taught. What is None is that of the app before it."""

    do: Literal["insert"] = "insert"
    after: AppReference | None  # None: first
    kind: AppKind
    seconds: Annotated[float, Field(gt=0.0, le=600.0)] = 2.0  # that it takes
    name: AppLabel | None = None
    target: FiniteVector | None = None  # [m] base frame
    force: FiniteVector | None = None  # [N] that the robot exerts, base frame
    gripper_width: Amount | None = None  # [m]


class ReplacePart(Message):
    """The apps from `first` to `last` are replaced by those of another session of the station.

    The service takes the apps as they are at the edit. What becomes of that session changes nothing.
    """

    do: Literal["replace_part"] = "replace_part"
    first: AppReference  # where it begins, the first new app begins
    last: AppReference
    session: Name  # closed, with apps, of the same robot and wrench source


class NameProgram(Message):
    """The program is called this."""

    do: Literal["name"] = "name"
    name: TaskName


ProgramChange = Annotated[
    ChangeApp | MoveApp | DeleteApp | DuplicateApp | InsertApp | ReplacePart | NameProgram,
    Field(discriminator="do"),
]
ProgramAction = Annotated[
    ChangeApp | MoveApp | DeleteApp | DuplicateApp | InsertApp | ReplacePart | NameProgram | Undo | Redo,
    Field(discriminator="do"),
]


class EditProgram(Message):
    """Command: edit the program of a session, open or closed. What was inferred stays beneath the edits.

    Refused where the program has another `edit_revision`: another operator was first.
    """

    type: Literal["edit_program"] = "edit_program"
    session: Name
    revision: Count  # `edit_revision` of the program, as the author has seen it
    author: Author
    action: ProgramAction


Command = Annotated[Open | Close | Edit | Preview | Describe | EditProgram, Field(discriminator="type")]


class Control(Message):
    """What a bridge or an operator asks of a station's session; payload of a `control` query."""

    command: Command


class SegmentOutline(Message):
    """A segment, as far as an effect states it."""

    t0: Seconds  # [s]
    tn: Seconds  # [s]
    kind: Kind


class AppOutline(Message):
    """An app, as far as an effect states it."""

    kind: AppKind
    t0: Seconds  # [s]
    tn: Seconds  # [s]
    target: Vector | None = None  # [m] base frame
    force: Vector | None = None  # [N] what the robot exerts
    load_kg: float | None = None
    gripper_width: float | None = None  # [m]


class PhaseOutline(Message):
    """A phase, as far as an effect states it."""

    t0: Seconds  # [s]
    tn: Seconds  # [s]
    kind: PhaseKind
    name: PhaseName | None = None


class EditEffect(Message):
    """What an edit changes: the segments, apps and phases that go, and those that take their place.

    From the first one that differs to the last one, at the same moment. One differs where its outline does.
    """

    first_segment: Count  # index of the first one, before and after
    segments_before: Annotated[Listed[SegmentOutline], Field(max_length=MAX_EFFECT_ROWS)] = ()
    segments_after: Annotated[Listed[SegmentOutline], Field(max_length=MAX_EFFECT_ROWS)] = ()
    first_app: Count  # index of the first one in the program, before and after
    apps_before: Annotated[Listed[AppOutline], Field(max_length=MAX_EFFECT_ROWS)] = ()
    apps_after: Annotated[Listed[AppOutline], Field(max_length=MAX_EFFECT_ROWS)] = ()
    first_phase: Count = 0  # index of the first one, before and after
    phases_before: Annotated[Listed[PhaseOutline], Field(max_length=MAX_EFFECT_ROWS)] = ()
    phases_after: Annotated[Listed[PhaseOutline], Field(max_length=MAX_EFFECT_ROWS)] = ()
    more: Count = 0  # rows that are not listed, of all six together


class Ack(Message):
    """A command was carried out."""

    session: Name
    next_seq: Count  # the batch that the service waits for
    state: Literal["open", "closed"]
    revision: Count = 0  # how many edits the session has had; undo and redo count
    effect: EditEffect | None = None  # of a preview, or of an edit `with_effect`; None from an older service


# --- operator to bridge ---------------------------------------------------------------------------------


class Start(Message):
    """Command to a bridge in standby: open a session and send samples. The same id starts only once."""

    type: Literal["start"] = "start"
    id: Name  # of this command; its sender chooses it, and repeats it where no answer came
    session: Name | None = None  # None: named after the time
    description: Description = Description()


class Stop(Message):
    """Command to a bridge in standby: send what is left and close the session. Repeating it is no error."""

    type: Literal["stop"] = "stop"
    session: Name | None = None  # None: the current one
    success: bool | None = None  # of the demonstration; None: not stated


class BridgeControl(Message):
    """What an operator asks of a bridge in standby; payload of a `bridge_control` query."""

    command: Annotated[Start | Stop, Field(discriminator="type")]


class BridgeAck(Message):
    """A bridge has carried out a command."""

    session: Name  # that was started or stopped
    state: BridgeState  # of the bridge, now


class BridgeStatus(Message):
    """What a bridge in standby is doing: published once a second, and at every change."""

    station: Name
    bridge: Name
    state: BridgeState
    source: Annotated[str, Field(max_length=64)]  # its name, such as `franky`
    session: Name | None = None  # that is being taught or stored
    description: Description | None = None  # with which that was started
    problem: Annotated[str, Field(max_length=1000)] | None = None  # why it cannot be started or stored now
    last_session: Name | None = None  # the one before
    outcome: Annotated[str, Field(max_length=1000)] | None = None  # what became of the one before, in words


# --- results --------------------------------------------------------------------------------------------


class Changepoint(Message):
    """A time at which one segment ends and the next begins."""

    t: Seconds  # [s]
    probability: Probability  # smoothed, given everything up to now
    certainty: Certainty  # a final one is never revised but by an edit
    t_low: Seconds | None = None  # [s] it lies between these two with probability 0.9
    t_high: Seconds | None = None
    corrected: bool = False  # an operator set it


class ScrewMotion(Message):
    """How a turning moves, base frame: about which axis, how far along it, and against which torque."""

    axis: Vector  # of unit length; the turn is positive about it
    point: Vector  # [m] of the axis, nearest to the flange where the turning begins
    angle: float  # [rad] about the axis, more than a whole turn where it is
    pitch_m: float  # [m] along the axis in one whole turn; above 0 as a right-handed screw
    pitch_sd_m: float  # standard deviation of that
    torque: Vector | None = None  # [Nm] held, about the point; None where the session reports no torque


class Segment(Message):
    """A stretch of the demonstration under one model. Consecutive ones share their boundary."""

    t0: Seconds  # [s]
    tn: Seconds  # [s]
    kind: Kind
    motion: Motion
    contact: Contact
    probability: Probability  # of this kind, given the boundaries
    runner_up: Kind | None  # the second most probable kind
    log_odds: float  # of the kind over the runner-up
    certainty: Certainty  # final once its end is final
    position_start: Vector  # [m] base frame
    position_end: Vector  # [m]
    force_start: Vector  # [N] base frame, on the robot, tared
    force_end: Vector  # [N]
    force_held: Vector | None  # [N] contact and sliding: the press proper, without touching and letting go
    load_kg: float | None  # transport and hold: what is carried
    load_sd_kg: float | None
    corrected: bool = False  # an operator set its kind
    turn: Vector | None = None  # [rad] base frame: axis times angle, of all turns together
    centre: Vector | None = None  # [m] turning: the point of its axis that is nearest to where it begins
    screw: ScrewMotion | None = None  # turning: its torque is that of the environment on the robot

    @property
    def force(self) -> Vector:
        """[N] what it was held with; without a contact, what there was at its end."""
        return self.force_held or self.force_end


class Phase(Message):
    """A run of segments that make one skill: reach, wipe, carry. Phases follow each other without a hole.

    A phase of contact may hold short free segments, in which the tool lifts off between two strokes.
    """

    t0: Seconds  # [s] where its first segment begins
    tn: Seconds  # [s] where its last segment ends
    kind: PhaseKind
    probability: Probability  # that a phase of this kind starts here
    certainty: Certainty  # a final one is never revised but by an edit
    first_segment: Count
    last_segment: Count
    strokes: Annotated[int, Field(ge=1)] = 1  # runs of segments in its contact state
    name: PhaseName | None = None  # that an operator gave it


class Gap(Message):
    """Samples that never came: nothing is known between the two times.

    Where what came before the first sample or after the last one is lost, both are that sample's time.
    """

    t0: Seconds
    tn: Seconds
    reason: Literal["source", "evicted"]  # the source paused, or no ring has the samples any more


class Result(Message):
    """Fields of every result, by which a reader separates old from new and lost from late."""

    station: Name
    session: Name
    instance: Name
    epoch: Count  # of the session's owner; readers keep the highest
    seq: Count  # counts the messages of this stream from 0
    t: Seconds  # [s] the last observation that it speaks of


class Changepoints(Result):
    """All changepoints from the `first` on; those before it stay as they were."""

    first: Count
    changepoints: Listed[Changepoint]


class Segments(Result):
    """All segments from the `first` on; those before it stay as they were.

    The last one of an open session still grows: its end is published once a second.
    Likewise all phases from the `first_phase` on. An older service sends none.
    """

    first: Count
    segments: Listed[Segment]
    first_phase: Count = 0
    phases: Listed[Phase] = ()


class Posterior(Result):
    """Probability of each possible start of the current segment."""

    starts: Listed[float]  # [s]
    probabilities: Listed[float]


class Hint(Message):
    """What a teacher can do better, raised while the demonstration goes on."""

    kind: HintKind
    since: Seconds  # [s] the observation at which it was raised
    until: Seconds | None = None  # [s] the observation at which it was cleared; None: it is active
    text: HintText  # what was found, with the value and its limit
    advice: HintText  # what to do
    t0: Seconds | None = None  # [s] the part of the demonstration that it is about, where there is one
    tn: Seconds | None = None


class Hints(Result):
    """All active hints and the newest of those that are cleared, by the time at which they were raised.

    Each message is complete: only the newest counts. No hint is active once the session is closed.
    """

    hints: Annotated[tuple[Hint, ...], Field(max_length=MAX_HINTS, fail_fast=True)]


class WrenchReport(Message):
    """What the wrench is worth in this session."""

    source: WrenchSource  # the one in use
    stated: bool = True  # False: the session does not state its source, and `source` is assumed
    hand_on_robot: HandOnRobot = "unknown"
    contact_models: bool  # are contact and free space distinguished?
    transport_models: bool  # is a load weighed?
    tare: Vector | None  # [N] bias taken off; None while there has been no rest to take it from
    note: str
    frame: ForceFrame = "base"  # of the samples' forces; those of results are in the base frame


class Refusal(Message):
    """The last message that was refused, with the error that its sender gets."""

    code: ErrorCode
    message: str


class Budget(Message):
    """What a station may use of one thing, and what it has used; in the unit of the thing."""

    per_s: Amount  # so much comes back every second
    at_once: Amount  # so much may be used at once, after a pause
    used: Amount  # of `at_once`, now; work may pass it, because what it takes is known afterwards
    refused: Count  # messages that were dropped or refused because of it, since the service started


class StationBudgets(Message):
    """What one station may use of an instance of the service. What it sends beyond that is held back.

    Samples that are dropped are asked for again; commands are refused as `overloaded`.
    """

    station: Name
    work: Budget  # [s] of the worker's time
    messages: Budget  # samples and heartbeats; replayed ones do not count
    bytes: Budget  # of these
    commands: Budget
    previews: Budget | None = None  # [s] of the worker's time, not among `work`; None: an older service


class SessionStatus(Result):
    """How the session is doing."""

    state: Literal["open", "closed"]
    preset: Name
    wrench: WrenchReport
    delay_s: float  # [s] what conditioning adds before a sample is looked at
    batches: Count
    samples: Count
    observations: Count
    duplicates: Count  # batches that came again
    repeats: Count  # samples whose time did not advance
    waiting_for: Count | None  # the batch that is missing, where one is
    gaps: Listed[Gap]  # the newest MAX_GAPS
    refused: Counted
    last_refusal: Refusal | None
    hypotheses: Count
    capped: Count  # steps on which the limit on hypotheses bit
    gaps_before: Count = 0  # gaps that are not listed
    lost: Count = 0  # batches that were given up, or whose content was refused; each is in a gap
    dropped: Count = 0  # batches for which the service had no room, and asked again
    overloaded: bool = False  # its station's share of the service's queue, or the queue, is filling up
    revision: Count = 0  # how many edits it has had; undo and redo count
    undoable: bool = False  # is there a correction to take back?
    redoable: bool = False  # is there one that was taken back?
    length_unit: LengthUnit = "m"  # of the samples' positions; results are in metres
    budgets: StationBudgets | None = None  # of its station; None from an older service
    description: Description = Description()  # what people state about it
    described: Count = 0  # how often `Describe` has changed that
    opened: Seconds | None = None  # [s] time of day (UTC) of its opening; None where that is not known


class ViaPoint(Message):
    """A pose of the flange on the way, base frame."""

    t: Seconds  # [s]
    position: Vector  # [m]
    orientation: Quaternion | None  # x y z w
    velocity: Vector | None = None  # [m/s] with which it was passed; None at the start
    angular_velocity: Vector | None = None  # [rad/s] likewise; None where no orientation is known


class AppPath(Message):
    """The way from the start of an app to its target, as it was taught.

    The reproduced path leads through its start, the via points and the app's target; `caesura_protocol.paths`
    has the curve between them. Without a via point it is the straight line.
    """

    start: ViaPoint  # where the demonstration was; the robot may begin elsewhere
    via: Annotated[tuple[ViaPoint, ...], Field(max_length=MAX_VIA_POINTS)] = ()
    tn: Seconds  # [s] at the target
    length_m: float  # of the demonstrated path
    deviation_m: float  # largest distance from the demonstrated path to the reproduced one
    deviation_rad: float  # largest angle between the two, 0 where no orientation is known
    tolerance_m: float  # that was asked for
    tolerance_rad: float


class AppChange(Message):
    """A field of an app that a person has set."""

    field: ChangedField
    author: Author
    edit: Count  # its number
    inferred: Shown = None  # the value without edits; of a force its size [N]


class RestForce(Message):
    """How hard a stroke is pressed while it rests: before its path begins, or after it has ended."""

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


class Correction(Message):
    """A correction of a session, and whether it counts."""

    number: Count  # of this one, from 1; undo and redo count
    author: Author
    at: Seconds  # [s] time of day (UTC)
    action: Annotated[Change, Field(discriminator="do")]
    state: EditState = "applied"
    reason: str | None = None  # why it is not applied


class ProgramEdit(Message):
    """An edit of a program, and what became of it."""

    number: Count  # of this one, from 1; undo and redo count
    author: Author
    at: Seconds  # [s] time of day (UTC)
    action: ProgramChange
    state: EditState
    reason: str | None = None  # why it is not applied
    apps: Annotated[
        Listed[App], Field(max_length=MAX_PART_APPS)
    ] = ()  # of `replace_part`: as they were taught


class Program(Message):
    """The task program as far as it has been taught."""

    station: Name
    session: Name
    instance: Name
    epoch: Count
    version: Count
    t: Seconds
    complete: bool  # the session is closed
    apps: Listed[App]
    notes: Listed[str] = ()  # what a reader must know, e.g. that the wrench carries no contact
    revision: Count = 0  # how many edits the session has had; undo and redo count
    author: str | None = None  # of the last edit
    edited: float | None = None  # [s] time of day (UTC) of the last edit
    gaps: Annotated[tuple[Gap, ...], Field(max_length=MAX_GAPS)] = ()  # the newest ones
    wrench: WrenchReport | None = None  # what the force in it is worth
    force_limit_n: ForceLimit | None = None  # of the cell: no app exerts more; None: as it was taught
    robot: Name | None = None  # on which it was taught; None: not stated
    name: TaskName | None = None  # that a person gave it
    edit_revision: Count = 0  # how many `EditProgram` it has had; undo and redo count
    edits: Annotated[tuple[ProgramEdit, ...], Field(max_length=MAX_PROGRAM_EDITS)] = ()  # oldest first
    corrections: Annotated[tuple[Correction, ...], Field(max_length=MAX_CORRECTIONS)] = ()  # oldest first


class Snapshot(Message):
    """Everything so far, with the last number of each stream: where a late or lossy reader starts."""

    status: SessionStatus
    changepoints: Changepoints
    segments: Segments
    posterior: Posterior | None
    program: Program
    hints: Hints | None = None  # None from an older service


class RecordedSamples(Message):
    """Samples of a session in a range of time, as the journal has them: nothing is computed between two.

    Of each bin and column the first sample with the least value, and the first with the greatest, in the
    order of time; one point where both are the same sample. A bin without samples has no point. Bins begin
    at multiples of `bin_s`; those at the ends of the range are whole.

    Positions are in metres; forces and torques as they were sent (see `force_frame`). Only `speed` is
    computed: the distance between the mean position of the last 40 ms and that of the 40 ms before, by the
    time between them. Without positions it is that of all joints together [rad/s].
    """

    station: Name
    session: Name
    instance: Name
    epoch: Count  # of the session's owner; readers keep the highest
    t0: Seconds  # [s] the range that was asked for
    tn: Seconds  # [s]
    bin_s: Amount  # [s] width of a bin
    available: Annotated[Listed[str], Field(max_length=MAX_COLUMNS)]  # columns that the session has
    columns: Annotated[Listed[str], Field(max_length=MAX_COLUMNS)]  # those of them that were asked for
    counts: Annotated[Listed[Count], Field(max_length=MAX_COLUMNS)]  # points of each column
    points: bytes  # little-endian float64, a pair (t, value) a point, column by column
    first: Seconds | None  # [s] the first sample of the session; None where it has none
    last: Seconds | None  # [s] its last one in the journal: what comes later is not recorded, or not yet
    holes: Annotated[Listed[Gap], Field(max_length=MAX_HOLES)] = ()  # in the range, from sample to sample
    holes_more: Count = 0  # shorter ones that are not listed
    force_frame: ForceFrame = "base"


class JournalReport(Message):
    """How an instance keeps what its sessions are made of."""

    kind: Literal["memory", "sqlite"]
    commit_s: Annotated[float, Field(ge=0.0)]  # [s] a record waits at most so long to be written
    size: Count  # [bytes] of all sessions
    size_limit: Count  # [bytes] past which closed sessions are dropped, oldest first
    waiting: Count = 0  # [bytes] not yet written
    trouble: str | None = None  # why nothing can be written now


class ServiceStatus(Message):
    """How an instance of the service is doing."""

    instance: Name
    epoch: Count
    version: str
    sessions_open: Count
    sessions_closed: Count
    messages: Count
    refused: Counted
    last_refusal: Refusal | None
    queue: Count
    queue_capacity: Count
    dropped: Count
    journal: JournalReport | None = None  # None from an older instance
    overloaded: bool = False  # more than it can do arrives; said before anything is dropped
    time: Seconds | None = None  # [s] of day (UTC) there, at publishing; None from an older instance
    # Of the stations that come nearest to a limit, or that were refused something, fullest first.
    budgets: Annotated[tuple[StationBudgets, ...], Field(max_length=MAX_BUDGETS, fail_fast=True)] = ()


class Piece(Message):
    """Some of the bytes of a message that is too long for one. All of them, in order, are its payload."""

    encoding: Annotated[str, Field(max_length=100)]  # of the whole
    whole: Count  # the same in all pieces of one message
    number: Count  # of this one, from 0
    count: Annotated[int, Field(ge=1, le=MAX_WHOLE_BYTES // PIECE_BYTES)]
    payload: Annotated[bytes, Field(max_length=PIECE_BYTES)]


class Error(Message):
    """A refusal, as it goes over the wire (`reply_err`)."""

    code: ErrorCode
    message: str
    value: Shown = None
    limit: Shown = None
    expected: Shown = None
