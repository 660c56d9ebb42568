"""Checks that a program runs on a base with the mounting of the one on which it was taught.

Poses and forces are in the base frame, and gravity is not. With another mounting the weight of a load has
another direction, and the touched objects are elsewhere.
"""

from __future__ import annotations

import math

from caesura_protocol.messages import Vector
from caesura_protocol.number_words import fixed
from caesura_protocol.programs.checks.findings import Finding
from caesura_protocol.up_direction import APART_RAD, UP, tilt_between, up_in_words


def mounting_findings(taught: Vector | None, runs: Vector | None = None) -> list[Finding]:
    """Return a finding if the mounting differs from the taught one.

    taught, runs: away from gravity, in the base frame, as the program states it and of the base that runs it;
    None: not stated. A program that states none was taught with z upwards.
    """
    assumed = ", assumed" if taught is None else ""
    words = f"was taught with {up_in_words(taught or UP)} upwards{assumed}"
    if runs is None:
        if tilt_between(taught, UP) <= APART_RAD:
            return []
        remedy = "run it on a base with this mounting, and set the mounting in its controller"
        return [Finding("warning", None, None, f"{words}: {remedy}")]
    apart, limit = math.degrees(tilt_between(taught, runs)), math.degrees(APART_RAD)
    if apart <= limit:
        return []
    reason = (
        f"{words}, and the base that runs it has {up_in_words(runs)} upwards, {fixed(apart, 0)}° apart, "
        f"expected at most {fixed(limit, 0)}°: gravity acts in another direction. Teach it on that base"
    )
    return [Finding("error", None, None, reason, apart, limit)]
