"""Phases of a demonstration: runs of segments that make one skill, such as reach, wipe, retract.

A scenario says with which step a skill begins and which event that is. When the event happened, the truth of
the segments says. A rest belongs to the phase before it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Literal, NamedTuple

Event = Literal["start", "contact_on", "contact_off"]
FIRST = "reach"


class Beginning(NamedTuple):
    """A skill by name, the event with which it begins, and when the hand means to begin it [s]."""

    name: str
    event: Event
    meant_s: float


def phases_of(
    beginnings: Sequence[Beginning], changepoints: Sequence[dict[str, Any]], end_s: float
) -> list[dict[str, Any]]:
    """Phases from 0 to end_s [s], each from its event on; none where no skill begins.

    An event is the nearest of its kind to when it was meant. Raises ValueError where there is none, or where
    two skills begin with one.
    """
    if not beginnings:
        return []
    times = [0.0, *(_time(beginning, changepoints) for beginning in beginnings), end_s]
    names = [FIRST, *(beginning.name for beginning in beginnings)]
    if any(after <= before for before, after in pairwise(times)):
        raise ValueError(f"phases {names} begin at {times[:-1]} s, expected each after the one before")
    return [{"t0": t0, "t1": t1, "name": name} for name, (t0, t1) in zip(names, pairwise(times), strict=True)]


def _time(beginning: Beginning, changepoints: Sequence[dict[str, Any]]) -> float:
    times = [float(mark["t"]) for mark in changepoints if mark["kind"] == beginning.event]
    if not times:
        raise ValueError(f"phase {beginning.name!r} begins with {beginning.event}, which never happened")
    return min(times, key=lambda t: abs(t - beginning.meant_s))
