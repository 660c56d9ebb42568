"""Consecutive steps of one kind, with the context from which their apps are built."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from types import MappingProxyType
from typing import Any

from caesura_protocol.app_kinds import AppKind
from caesura_protocol.messages import App, Contact, Segment, Vector
from caesura_protocol.screw_torque_and_text import exerted
from caesura_service.program.apps.paths import Paths
from caesura_service.program.forces.stroke_forces import has_own_force
from caesura_service.program.interpretation.joined_strokes import DECAY_REACH_M, only_touches, stands
from caesura_service.program.interpretation.touches import pushes_back
from caesura_service.program.program_segment import (
    GRIP_SLACK_S,
    OBSERVED_S,
    GripperAction,
    Moment,
    MomentAt,
    ProgramSegment,
    length,
    observed,
)

SETTLES_S = 0.15  # after a turn, until the hand is still
UNCHANGED: Mapping[str, object] = MappingProxyType({})
STILL_PRESSED = 0.7  # of a force: who presses less is letting go
TURNS_AS: dict[Contact, str] = {"free": "motion", "contact": "sliding", "transport": "transport"}


@dataclass(frozen=True)
class AppGroup:
    """Consecutive segments with one group key, and the context from which their apps are built."""

    steps: list[ProgramSegment]
    before: ProgramSegment | None  # the last step of the group before it
    after: Sequence[Sequence[ProgramSegment]]  # the steps of the two groups that follow
    grips: list[GripperAction]  # not yet used; those that belong to a contact are taken out
    moment_at: MomentAt
    force_limit_n: float | None
    paths: Paths | None

    @property
    def contact(self) -> ProgramSegment | None:
        """The contact that follows the group, at once or after rests; None without one.

        For a press after a rest, the touch was before that rest. None if the fingers move in such a rest:
        then nothing was touched before. At its end they move with a press, but before a movement in contact.
        """
        steps = [step for group in self.after for step in group]
        contact = next((step for step in steps if not self._rests(step)), None)
        if contact is None or not contact.touches:
            return None
        slack_s = 0.0 if contact.segment.motion == "motion" else GRIP_SLACK_S
        moves = any(steps[0].t0 <= grip.t < contact.t0 - slack_s for grip in self.grips)
        return None if moves else contact

    def _rests(self, step: ProgramSegment) -> bool:
        segment = step.segment
        turns = self.paths is not None and self.paths.turning(segment.t0, segment.tn)
        return segment.kind == "steady" and not turns

    def moving(
        self,
        kind: AppKind,
        step: ProgramSegment,
        end: AppEnd | None = None,
        changes: Mapping[str, object] = UNCHANGED,
        begun: float | None = None,
    ) -> App:
        """Return an app over a step with its path, from `begun` [s] to `end`.

        Without them, the path begins and ends with the step's segment. changes: other fields of the app.
        """
        t0, tn = step.segment.t0, step.segment.tn if end is None else end.t
        if begun is not None:
            late = begun - t0 > OBSERVED_S
            t0, changes = begun, {**changes, **({"t0": begun} if late else {})}
        path = self.paths.between(t0, tn) if self.paths is not None and tn > t0 else None
        screw = exerted(step.segment.screw) if step.segment.kind == "turning" else None
        return self.app(kind, [step], path=path, screw=screw, **({} if end is None else end.where), **changes)

    def app(self, kind: AppKind, steps: Sequence[ProgramSegment], **changes: object) -> App:
        """Return an app over consecutive steps, with the pose at their end; changes: its other fields."""
        last, parts = steps[-1].segment, [part for step in steps for part in step.parts]
        moment = self.moment_at(last.tn)
        fields: dict[str, object] = {
            "kind": kind,
            "t0": parts[0].segment.t0,
            "tn": parts[-1].segment.tn,
            "target": last.position_end,
            "orientation": moment.orientation,
            "joints": moment.joints,
            "force": None,
            "force_taught": None,
            "load_kg": None,
            "load_sd_kg": None,
            "gripper_width": None,
            "confidence": min(part.confidence for part in parts),
            "segments": tuple(part.index for part in parts),
        }
        return App.model_validate(fields | changes)

    def touch(self) -> AppEnd | None:
        """Return the end of the last movement at the contact that follows; None without a contact.

        A rest before the contact is a pause, no part of the path: the time is at most that of the movement's
        end.
        """
        approach, contact = self.steps[-1].segment, self.contact
        if contact is None:
            return None
        end = self.touched(contact, approach)
        at_once = contact is self.after[0][0]
        return end if at_once else replace(end, t=min(end.t, approach.tn))

    def rest(self, step: ProgramSegment) -> AppEnd | None:
        """Return the end of a turn where the hand has come to rest; None unless a rest follows the step.

        The last degrees of a turn are slower than a turn, so they lie in the rest.
        """
        following = self.after[0][0] if self.after else None
        if following is None or step is not self.steps[-1] or following.segment.kind != "steady":
            return None
        t = min(step.segment.tn + SETTLES_S, following.segment.tn)
        return AppEnd(t, pose_fields(self.moment_at(t)))

    def touched(self, contact: ProgramSegment, approach: Segment | None = None) -> AppEnd:
        """Return the first time and pose at which a contact pushes back.

        That may be before the contact, at the end of `approach`. On its last `DECAY_REACH_M` the tool may hit
        and bounce: one observation pushes back, and a robot stops there. If none pushes back, it is the first
        observation, or the end of a contact that begins with its approach: its touch lies after the last one.
        """
        pushes = pushes_back(contact.parts[0], self.moment_at)
        first = contact.segment.tn if contact.arrives else observed(contact.t0, contact.tn)[0]
        begin = contact.t0 if approach is None else approach.tn
        before = [] if approach is None else observed(approach.t0, approach.tn)
        early = list(takewhile(pushes, reversed(before)))
        place = self.moment_at(begin).position
        near = takewhile(
            lambda t: math.dist(self.moment_at(t).position, place) < DECAY_REACH_M, reversed(before)
        )
        hits = list(filter(pushes, near))
        early = early or (hits if len(hits) == 1 else [])
        t = early[-1] if early else next(filter(pushes, observed(begin, contact.tn)), first)
        return AppEnd(t, pose_fields(self.moment_at(t)))

    def is_approached(self, contact: ProgramSegment) -> bool:
        """Return whether a contact begins with its approach: one that pushes back from its start has none."""
        first = observed(contact.t0, contact.tn)[0]
        return contact.arrives and not pushes_back(contact.parts[0], self.moment_at)(first)

    def fingers_moved(self) -> float | None:
        """Return the time [s] by which the fingers have moved in a rest before a press; None without a move.

        The pressed object is touched only after that time.
        """
        following = self.after[0][0] if self.after else None
        if following is None or not following.touches or self.is_approached(following):
            return None
        if any(grip.is_near(following.t0, following.tn) for grip in self.grips):
            return None
        t0, tn = self.steps[0].segment.t0, self.steps[-1].segment.tn
        moved = [grip.t for grip in self.grips if t0 <= grip.t < tn - GRIP_SLACK_S]
        return max(moved) + OBSERVED_S if moved else None

    @property
    def only_touches(self) -> bool:
        """Whether the group is only the touch of a contact that continues as a stroke, with no lasting
        press.
        """
        strokes = self.after[0] if self.after else ()
        goes_on = bool(strokes) and group_key(strokes[0]) == "sliding"
        return goes_on and len(self.steps) == 1 and only_touches(self.steps[0], self.moment_at)

    def landed(self) -> float | None:
        """Return the time [s] at which a stroke that begins in the air touches the surface.

        The movement to the surface belongs to the app before. None if the stroke begins in contact or at the
        start of the program, or touches only at its end.
        """
        first = self.steps[0]
        if first.rests_before or self.before is None or self.before.touches:
            return None
        t = self.touched(first).t
        return t if t < first.segment.tn - OBSERVED_S else None

    def ended(self, stroke: ProgramSegment) -> AppEnd | None:
        """Return the end of a stroke's path in a rest without a force of its own; None without such a rest.

        The tool may still move in it.
        """
        if not stroke.rests_after or has_own_force(stroke.rests_after):
            return None
        last = stroke.rests_after[-1].segment
        return AppEnd(last.tn, pose_fields(self.moment_at(last.tn)) | {"target": last.position_end})

    def pressed(self, hardest: ProgramSegment) -> AppEnd | None:
        """Return the last time and pose with a force of `STILL_PRESSED` of the press; None without one.

        The segment itself may end later, while the hand lets go. hardest: the step whose force counts.
        """
        times, force = observed(self.steps[0].segment.t0, self.steps[-1].segment.tn), hardest.force
        least = _along(hardest.base, force) + STILL_PRESSED * length(force)
        held = (t for t in reversed(times) if _along(self.moment_at(t).force, force) >= least)
        t = next(held, None)
        return None if t is None else AppEnd(t, pose_fields(self.moment_at(t)))


@dataclass(frozen=True)
class AppEnd:
    """The time [s] and pose at which an app ends, where they differ from the end of its segment."""

    t: float
    where: dict[str, Any]


def group_key(step: ProgramSegment) -> str:
    """Return the kind of group that a step belongs to.

    Transport and hold form one carry. A movement that pushes a yielding object in is part of the press.
    """
    kind, contact = step.segment.kind, step.segment.contact
    if stands(step) and not step.segment.corrected and not step.rests_before and not step.rests_after:
        return "contact"
    if kind == "turning":
        return TURNS_AS[contact]
    if kind == "sliding" and step.gives_way:
        return "contact"
    return "transport" if kind == "hold" else kind


def pose_fields(moment: Moment) -> dict[str, Any]:
    """Return the fields of an app that state a pose, with those of a moment."""
    return {"target": moment.position, "orientation": moment.orientation, "joints": moment.joints}


def _along(force: Vector | None, direction: Vector) -> float:
    """Return the component [N] of a force along a direction; 0 where the force is None."""
    if force is None:
        return 0.0
    return sum(a * b for a, b in zip(force, direction, strict=True)) / max(length(direction), 1e-12)
