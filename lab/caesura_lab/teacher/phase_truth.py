"""Phases of a demonstration: runs of segments that make one skill, such as reach, wipe, retract.

A scenario states with which step and event a skill begins. The time of the event follows from the truth of
the segments. A rest belongs to the phase before it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Literal, NamedTuple

Event = Literal["start", "contact_on", "contact_off"]
FIRST_PHASE = "reach"


class PhaseStart(NamedTuple):
    """Start of a phase: name of the skill, the event that begins it, and the intended time [s]."""

    name: str
    event: Event
    intended_s: float


def phases_of(
    starts: Sequence[PhaseStart], changepoints: Sequence[dict[str, Any]], end_s: float
) -> list[dict[str, Any]]:
    """Return the phases from 0 to end_s [s], each from its event on.

    Of several events of a kind, a phase begins with the one nearest to the intended time, after the phase
    before it has begun. Empty if no skill begins, or if an event did not happen, such as a contact when the
    hand grasps in the air: the phase of that time is then unclear.
    """
    times = [0.0]
    for name, event, intended_s in starts:
        del name
        found = [mark["t"] for mark in changepoints if mark["kind"] == event and mark["t"] > times[-1]]
        if not found:
            return []
        times.append(min(found, key=lambda t: abs(t - intended_s)))
    names = [FIRST_PHASE, *(start.name for start in starts)]
    ends = pairwise([*times, end_s])
    phases = [{"t0": t0, "t1": t1, "name": name} for name, (t0, t1) in zip(names, ends, strict=True)]
    return phases if starts else []
