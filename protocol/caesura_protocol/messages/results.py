"""Results of a session: changepoints, segments, phases, gaps and hints."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from caesura_protocol.messages.field_types import (
    Certainty,
    Contact,
    Count,
    HintKind,
    HintText,
    Kind,
    Listed,
    Motion,
    Name,
    PhaseKind,
    PhaseName,
    Probability,
    Seconds,
    Vector,
)
from caesura_protocol.messages.limits import MAX_HINTS, MAX_STARTS
from caesura_protocol.messages.message import Message


class Changepoint(Message):
    """A time at which one segment ends and the next begins."""

    t: Seconds  # [s]
    probability: Probability  # smoothed, given everything up to now
    certainty: Certainty  # a final one is never revised but by an edit
    t_low: Seconds | None = None  # [s] it lies between these two with probability 0.9
    t_high: Seconds | None = None
    corrected: bool = False  # an operator set it


class ScrewMotion(Message):
    """Screw motion of a turning, base frame: its axis, angle and pitch, and the torque that is held."""

    axis: Vector  # of unit length; the turn is positive about it
    point: Vector  # [m] of the axis, nearest to the flange where the turning begins
    angle: float  # [rad] about the axis, more than a whole turn where it is
    pitch_m: float  # [m] along the axis in one whole turn; above 0 as a right-handed screw
    pitch_sd_m: float  # standard deviation of that
    torque: Vector | None = None  # [Nm] held, about the point; None where the session reports no torque


class Segment(Message):
    """A part of the demonstration under one model. Consecutive ones share their boundary."""

    t0: Seconds  # [s]
    tn: Seconds  # [s]
    kind: Kind
    motion: Motion
    contact: Contact
    probability: Probability  # of this kind, given the boundaries
    runner_up: Kind | None  # the second most probable kind
    log_odds: float  # of the kind over the runner-up; below 0 if only the segments around it favour the kind
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
        """Force [N] that lasted during the segment; without a contact, the force at its end."""
        return self.force_held or self.force_end


class Phase(Message):
    """Consecutive segments that form one skill: reach, wipe, carry. Phases follow each other without a gap.

    A phase of contact may contain short free segments, in which the tool lifts off between two strokes.
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
    """Missing samples: there are no observations between the two times.

    If the samples before the first or after the last one are lost, both times are that sample's.
    """

    t0: Seconds
    tn: Seconds
    reason: Literal["source", "evicted"]  # the source paused, or no ring has the samples any more


class Result(Message):
    """Common fields of results: by them a reader distinguishes old from new and lost from delayed ones."""

    station: Name
    session: Name
    instance: Name
    epoch: Count  # of the session's owner; readers keep the highest
    seq: Count  # counts the messages of this stream from 0
    t: Seconds  # [s] the last observation that it speaks of


class Changepoints(Result):
    """All changepoints from number `first` on; earlier ones are unchanged."""

    first: Count
    changepoints: Listed[Changepoint]


class Segments(Result):
    """All segments from number `first` on, and all phases from `first_phase` on; earlier ones are unchanged.

    The last segment of an open session still grows: its end is published once a second. An older service
    sends no phases.
    """

    first: Count
    segments: Listed[Segment]
    first_phase: Count = 0
    phases: Listed[Phase] = ()


class Posterior(Result):
    """Probability of each possible start of the current segment."""

    starts: Annotated[Listed[float], Field(max_length=MAX_STARTS)]  # [s]
    probabilities: Annotated[Listed[float], Field(max_length=MAX_STARTS)]


class Hint(Message):
    """Advice to a teacher, raised during the demonstration.

    `kind` and `since` identify the hint. The other fields may change while it is active.
    """

    kind: HintKind
    since: Seconds  # [s] the observation at which it was raised
    until: Seconds | None = None  # [s] the observation at which it was cleared; None: it is active
    text: HintText  # what was found, with the value and its limit
    advice: HintText  # what to do
    t0: Seconds | None = None  # [s] the part of the demonstration that it is about, where there is one
    tn: Seconds | None = None


class Hints(Result):
    """All active hints and the newest of those that are cleared, by the time at which they were raised.

    Each message is complete, so only the newest counts. No hint is active once the session is closed.
    """

    hints: Annotated[Listed[Hint], Field(max_length=MAX_HINTS)]
