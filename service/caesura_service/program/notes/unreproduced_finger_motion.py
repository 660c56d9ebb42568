"""Motion of the fingers that no gripper event states.

It is too slow for one, is cut by an end of the recording, or leads back at once to where it began. After an
event the opening is that of the event. Where it is another one, the fingers have moved, unless an event that
they begin or end with explains it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.number_words import fixed, interval
from caesura_service.program.notes.largest_parts import largest_parts
from caesura_service.program.program_segment import GripperAction

Array = NDArray[np.float64]

MOVED_M = 0.005  # what is held gives way by less
BESIDE_S = 0.4  # between an event and the first or last observation of its motion
AT_LEAST = 2  # observations: one may be a reading that is wrong
NAMED = 3  # of them in a note, the widest ones


class _Motion(NamedTuple):
    """Fingers that are off the opening of the last event, between two times [s]: openings [m]."""

    began: float
    ended: float
    was: float
    furthest: float

    def size(self) -> float:
        """Return the distance [m] to the furthest opening; 0 where it is unknown."""
        return 0.0 if math.isnan(self.was) else abs(self.furthest - self.was)

    def overlaps(self, other: _Motion) -> bool:
        """Return whether another motion is seen at the same time."""
        return self.began <= other.ended and other.began <= self.ended

    def text(self) -> str:
        """Return the motion as text."""
        when = f"at {interval(self.began, self.ended, 1)} s"
        if math.isnan(self.was):
            return f"fingers that moved and moved back {when}"
        widths = f"{fixed(1000 * self.was, 0)} to {fixed(1000 * self.furthest, 0)} mm"
        return f"the fingers from {widths} {when}"


def unreproduced_finger_motion(
    times: Array,
    openings: Array,
    grips: Sequence[GripperAction],
    excursions: Sequence[tuple[float, float, float, float]] = (),
) -> Iterator[str]:
    """Yield text on each motion of the fingers without an event.

    times: (n,) [s], openings: (n,) [m], nan where unknown; grips: in time order; excursions: begin and end
    [s] of each motion back to where it began, with its first and its furthest opening [m], nan from a flag.
    """
    seen = _off_the_events(times, openings, grips)
    missed = [*seen, *(one for one in map(_Motion._make, excursions) if not any(map(one.overlaps, seen)))]
    yield from largest_parts(
        sorted(missed), _Motion.size, _Motion.text, NAMED, "shorter motions of the fingers"
    )


def _off_the_events(times: Array, openings: Array, grips: Sequence[GripperAction]) -> list[_Motion]:
    """Return the motions in which observed openings are off those of the events."""
    known = ~np.isnan(openings)
    times, openings = times[known], openings[known]
    stated = [grip for grip in grips if grip.width is not None]
    if times.size < AT_LEAST or len(stated) < len(grips):
        return []
    events = np.array([grip.t for grip in stated])
    levels = np.array([openings[0], *(grip.width for grip in stated)])[
        np.searchsorted(events, times, "right")
    ]
    off = np.abs(openings - levels) > MOVED_M
    beside_s = max(BESIDE_S, 2.0 * float(np.median(np.diff(times))))
    edges = np.flatnonzero(np.diff(off.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
    found = [_motion(times[first:end], openings[first:end], levels[first]) for first, end in edges]
    long = [one for (first, end), one in zip(edges, found, strict=True) if end - first >= AT_LEAST]
    return [one for one in long if not _is_explained(one, stated, beside_s)]


def _motion(times: Array, openings: Array, level: float) -> _Motion:
    """Return the motion of fingers that are off a level [m]."""
    furthest = openings[np.argmax(np.abs(openings - level))]
    return _Motion(float(times[0]), float(times[-1]), float(level), float(furthest))


def _is_explained(motion: _Motion, grips: Sequence[GripperAction], beside_s: float) -> bool:
    """Whether a motion begins with an event at which the fingers begin, or ends with one that ends it."""
    return any(abs(grip.t - (motion.began if grip.opens else motion.ended)) <= beside_s for grip in grips)
