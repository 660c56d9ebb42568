"""Incremental construction of the task program: apps before a quiet place are built only once.

A quiet place is a settled segment whose apps do not depend on earlier segments, and at whose start the
gripper does nothing. The fingers do not act in it, or shortly before, except near a contact: it would be
divided there. It is a motion that does not continue an earlier one, and does not follow a contact by two
segments. It is not part of a carry, nor is what the one before carries pushed back. With the motions and
carries into which it continues it is too long for the end of another motion. No contact follows it into which
it may press something. The program is then that of the segments before it, followed by that of the segments
from it on. If there is no quiet place in MOST_UNQUIET segments, the apps are divided at the last of them
without contact. A gap that affects earlier segments is known by then: a gap ends where a segment begins, and
the quiet place is a segment.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from caesura_protocol.messages import App, Gap, Vector
from caesura_protocol.up_direction import UP
from caesura_service.cooperative_scheduler import give_way
from caesura_service.program import (
    GRIP_SLACK_S,
    Context,
    GripperAction,
    Moment,
    MomentAt,
    Paths,
    ProgramSegment,
    away_from_contacts,
    holds,
    is_end_of_movement,
    kept_steps,
    may_end_movement,
    may_press_in,
    task_program,
    with_regrips,
)
from caesura_service.segmentation.encoded_log import EncodedMessageLog, MessageSequence

# Steps without a quiet place: far more than a person teaches (the hour of tests/bench/hour.py has 18 at
# most), and few enough that a view of other samples costs no more after an hour.
MOST_UNQUIET = 500


@dataclass
class IncrementalProgramBuilder:
    """Builds apps from segments as `task_program` does with gripper actions that `with_regrips` returns."""

    moment_at: MomentAt
    least_s: float
    paths: Paths | None = None
    force_limit_n: float | None = None  # [N] of the cell
    limited: Callable[[App], App] | None = None  # an app with the force limits of corrections
    up: Vector = UP  # away from gravity, base frame
    first: int = 0  # the segment from which on apps are built anew
    since: float = -np.inf  # [s] grips after this may still be used
    built: EncodedMessageLog[App] = field(
        default_factory=lambda: EncodedMessageLog(App)
    )  # from what lies before
    _last_built: App | None = None
    _seen: dict[float, Moment] = field(default_factory=dict)  # moments behind that, before the last segment
    _seen_until: float = -np.inf  # [s] what lies before is seen from both sides: no moment changes any more

    def apps(
        self,
        steps: Sequence[ProgramSegment],
        settled: int,
        grips: Sequence[GripperAction],
        gaps: Sequence[Gap] = (),
    ) -> Sequence[App]:
        """Return the apps of a demonstration, in time order.

        steps: from segment `first` on; settled: the number of segments that nothing can change any more;
        grips and gaps: all known ones, in time order. If a new grip lies before `since`, the caller must
        start with a new builder.
        """
        self._seen_until = steps[-1].segment.t0 if steps else -np.inf
        grips = _from_last_before(grips, steps[0].segment.t0 - GRIP_SLACK_S) if steps else grips
        grips = with_regrips(steps, Context(grips, self._moment, self.up))
        rest = [grip for grip in grips if grip.t > self.since]
        begin, settled = 0, settled - self.first
        while quiet := self._quiet(steps, begin, settled, rest, grips):
            place = steps[quiet]
            before = [grip for grip in rest if grip.t < place.segment.t0]
            apps = self._program(steps[begin : quiet + 1], before, gaps, grips)
            finished = [app for app in apps if not app.segments or app.segments[0] < place.index]
            self.built.extend(finished)
            self._last_built = finished[-1] if finished else self._last_built
            self.first, self.since = place.index, place.segment.t0 + GRIP_SLACK_S
            rest = [grip for grip in rest if grip.t > self.since]
            self._seen.clear()
            begin = quiet
            give_way()
        return MessageSequence(self.built, self._program(steps[begin:], rest, gaps, grips))

    def _program(
        self,
        steps: Sequence[ProgramSegment],
        grips: Sequence[GripperAction],
        gaps: Sequence[Gap],
        known: Sequence[GripperAction],
    ) -> tuple[App, ...]:
        apps = task_program(
            steps,
            grips,
            self._moment,
            least_s=self.least_s,
            force_limit_n=self.force_limit_n,
            paths=self.paths,
            gaps=gaps,
            known=known,
            app_before=self._last_built,
            up=self.up,
        )
        return apps if self.limited is None else tuple(map(self.limited, apps))

    def _moment(self, t: float) -> Moment:
        """Return the robot's state at a time [s], cached if no later segment can change it.

        A program needs many states, so this gives way to other work at each.
        """
        give_way()
        if (seen := self._seen.get(t)) is not None:
            return seen
        moment = self.moment_at(t)
        if t < self._seen_until:
            self._seen[t] = moment
        return moment

    def _quiet(
        self,
        steps: Sequence[ProgramSegment],
        begin: int,
        settled: int,
        grips: Sequence[GripperAction],
        known: Sequence[GripperAction],
    ) -> int:
        """Return the last quiet place among the next settled steps after `begin`; 0 if there is none.

        Of MOST_UNQUIET steps the last one without contact counts as quiet, from wherever the steps begin.
        """
        last = min(settled - 1, begin + MOST_UNQUIET)
        dividing = away_from_contacts(grips, steps, self.least_s)
        for i in range(last, begin, -1):
            step, t0 = steps[i], steps[i].segment.t0
            before, kind = steps[i - 1], step.segment.kind
            touched = before.touches or (i > 1 and steps[i - 2].touches) or self._touched_earlier(steps, i)
            touched = touched or (may_press_in(step) and (i + 1 >= settled or steps[i + 1].touches))
            moves = kind == "motion" and self._lasts(before) and not touched
            gripped = any(t0 <= grip.t <= t0 + GRIP_SLACK_S for grip in grips)
            # What is left of a movement that the fingers divide may be too short, and part of this one.
            parted = t0 - max(self.least_s, GRIP_SLACK_S) * (before.segment.kind in {"motion", "transport"})
            gripped = gripped or any(parted < grip.t < step.segment.tn for grip in dividing)
            quiet = self._lasts(step) and moves and not holds(step, known) and not gripped
            quiet = quiet and (before.segment.motion == "steady" or is_end_of_movement(t0, self._moment))
            quiet = quiet and not (
                holds(before, known) and self._touches(before, steps[begin : i + 1], known)
            )
            if quiet and not self._may_end_movement(steps[i:settled]):
                return i
        if last < begin + MOST_UNQUIET:
            return 0
        apart = (i for i in range(last, begin, -1) if not steps[i].touches and self._lasts(steps[i - 1]))
        return next(apart, last)

    def _touches(
        self, carry: ProgramSegment, steps: Sequence[ProgramSegment], known: Sequence[GripperAction]
    ) -> bool:
        """Return whether a carry among steps is interpreted as a contact: what it holds is pushed back.

        One that is moved or held against a resistance may have been a contact first.
        """
        kept = kept_steps(steps, known, self._moment, self.least_s, self.up)
        touching = (one for one in kept if one.touches or one.is_resisted)
        return any(part.index == carry.index for one in touching for part in one.parts)

    def _may_end_movement(self, steps: Sequence[ProgramSegment]) -> bool:
        """Return whether a movement is so short that it may be the end of the one before.

        The movements into which it continues are part of it. steps: from its first one to the last settled
        one; True if it may go on after that.
        """
        whole = steps[0]
        for step in steps[1:]:
            if may_end_movement(whole):
                return True
            kind, t0 = step.segment.kind, step.segment.t0
            moves = kind in {"motion", "transport"}  # fingers that hold nothing carry nothing
            if self._lasts(step) and (not moves or is_end_of_movement(t0, self._moment)):
                return False
            whole = step.joined_to(whole)
        return True

    def _touched_earlier(self, steps: Sequence[ProgramSegment], i: int) -> bool:
        """Return whether the last step that lasts, among those up to step `i` − 2, is in contact."""
        earlier = next((steps[k] for k in range(i - 2, -1, -1) if self._lasts(steps[k])), None)
        return earlier is not None and earlier.touches

    def _lasts(self, step: ProgramSegment) -> bool:
        """Whether a step passes the minimum time filter, and is longer than a grip may be off."""
        return step.lasts(max(self.least_s, GRIP_SLACK_S))


def _from_last_before(grips: Sequence[GripperAction], t: float) -> Sequence[GripperAction]:
    """Return the grips from a time [s] on, and the last one before it, which determines if something is
    held.
    """
    return grips[max(bisect_left(grips, t, key=lambda grip: grip.t) - 1, 0) :]
