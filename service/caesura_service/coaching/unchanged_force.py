"""The time for which the measured force stays equal while the flange moves, as with a dead driver.

A quantised sensor repeats its values too. Its repeats are shorter, and it has changed before. A force that
has never changed in a session may be one quantisation step for its first FIRST_FROZEN_S.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from caesura_protocol.wrench_faults import FROZEN_S, MOVED_M
from caesura_service.coaching.bias_drift_tracker import Vector

FIRST_FROZEN_S = 2.0


class UnchangedForce(NamedTuple):
    """A span in which a force has kept its size, to within rounding, and the position at its start."""

    measured_n: float  # [N]
    since: float  # [s]
    until: float  # [s]
    place: Vector  # [m] of the flange, at first
    has_changed: bool = False  # before
    has_steps: bool = False  # its sensor: before, it stayed the same for less than FROZEN_S

    @property
    def frozen_s(self) -> float:
        """Time [s] for which the force counts as frozen; 0 if it may be a quantisation step."""
        seconds = self.until - self.since
        is_known = self.has_changed or seconds > FIRST_FROZEN_S
        return seconds if is_known and not self.has_steps else 0.0


def begun(
    before: UnchangedForce | None, measured_n: float | None, t: float, place: Vector
) -> UnchangedForce | None:
    """Return the span that starts with a new size [N] of the force; None without a wrench.

    t: [s]; place: [m].
    """
    if measured_n is None:
        return None
    first = UnchangedForce(measured_n, t, t, place)
    if before is None:
        return first
    has_steps = before.has_steps or 0.0 < before.until - before.since < FROZEN_S
    return first._replace(has_changed=True, has_steps=has_steps)


def advanced(
    before: UnchangedForce | None, measured_n: float | None, t: float, place: Vector
) -> tuple[UnchangedForce | None, float]:
    """Return the span after the next force, and the time [s] for which the force is frozen.

    The time is 0 until the flange has moved by MOVED_M.
    """
    if before is None or measured_n is None or not math.isclose(measured_n, before.measured_n):
        return begun(before, measured_n, t, place), 0.0
    goes_on = before._replace(until=t)
    return goes_on, goes_on.frozen_s if math.dist(place, before.place) > MOVED_M else 0.0
