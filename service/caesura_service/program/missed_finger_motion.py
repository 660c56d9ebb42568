"""Motion of the fingers that no gripper event states: too slow for one, or cut by an end of the recording.

After an event the opening is that of the event. Where it is another one, the fingers have moved, unless an
event that they begin or end with explains it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.number_words import fixed, interval
from caesura_service.program.program_segment import GripperAction

Array = NDArray[np.float64]

MOVED_M = 0.005  # what is held gives way by less
BESIDE_S = 0.4  # between an event and the first or last observation of its motion
AT_LEAST = 2  # observations: one may be a reading that is wrong
NAMED = 3  # of them in a note, the widest ones
BEGUN = ("release", "open")  # at whose time the fingers begin to move; the others have settled


class _Motion(NamedTuple):
    """Fingers that are off the opening of the last event, between two times [s]: openings [m]."""

    began: float
    ended: float
    was: float
    furthest: float


def missed_finger_motion(times: Array, openings: Array, grips: Sequence[GripperAction]) -> Iterator[str]:
    """Yield text on each motion of the fingers without an event.

    times: (n,) [s], openings: (n,) [m], nan where unknown; grips: in time order.
    """
    known = ~np.isnan(openings)
    times, openings = times[known], openings[known]
    stated = [grip for grip in grips if grip.width is not None]
    if times.size < AT_LEAST or len(stated) < len(grips):
        return
    events = np.array([grip.t for grip in stated])
    levels = np.array([openings[0], *(grip.width for grip in stated)])[
        np.searchsorted(events, times, "right")
    ]
    off = np.abs(openings - levels) > MOVED_M
    beside_s = max(BESIDE_S, 2.0 * float(np.median(np.diff(times))))
    edges = np.flatnonzero(np.diff(off.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
    found = [_motion(times[first:end], openings[first:end], levels[first]) for first, end in edges]
    long = [one for (first, end), one in zip(edges, found, strict=True) if end - first >= AT_LEAST]
    missed = [one for one in long if not _is_explained(one, stated, beside_s)]
    widest = sorted(missed, key=lambda one: abs(one.furthest - one.was))[-NAMED:]
    for one in missed:
        if one in widest:
            widths = f"{fixed(1000 * one.was, 0)} to {fixed(1000 * one.furthest, 0)} mm"
            yield f"the fingers from {widths} at {interval(one.began, one.ended, 1)} s"
    if rest := len(missed) - len(widest):
        yield f"{rest} shorter motions of the fingers"


def _motion(times: Array, openings: Array, level: float) -> _Motion:
    """Return the motion of fingers that are off a level [m]."""
    furthest = openings[np.argmax(np.abs(openings - level))]
    return _Motion(float(times[0]), float(times[-1]), float(level), float(furthest))


def _is_explained(motion: _Motion, grips: Sequence[GripperAction], beside_s: float) -> bool:
    """Whether a motion begins with an event at which the fingers begin, or ends with one that ends it."""
    return any(
        abs(grip.t - (motion.began if grip.kind in BEGUN else motion.ended)) <= beside_s for grip in grips
    )
