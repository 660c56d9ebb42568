"""How the programs of two sessions differ, in words: apps side by side, and what is not alike in each pair.

Apps are paired in their order by kind. Differences below the limits of LIMITS are those of any two
demonstrations of one task.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from difflib import SequenceMatcher
from itertools import zip_longest
from typing import NamedTuple

from caesura_protocol.app_kinds import APP_KINDS
from caesura_protocol.messages import App, Program, Vector

ALIKE = "alike"
ANOTHER = "another app"
FIRST_ALONE, SECOND_ALONE = "only in the first", "only in the second"


class DifferenceLimits(NamedTuple):
    """From where on a difference is named: absolute, and as a share of the larger value."""

    target_m: float = 0.005
    force_n: float = 1.0
    load_kg: float = 0.05
    width_m: float = 0.002
    duration_s: float = 0.3
    share: float = 0.15


LIMITS = DifferenceLimits()


class Difference(NamedTuple):
    """A pair of apps, numbered from 1 as pages show them, and how they differ."""

    first: str
    second: str
    words: str


def differences(first: Program, second: Program, limits: DifferenceLimits = LIMITS) -> list[Difference]:
    """Every app of both programs, beside its counterpart where it has one."""
    kinds, others = ([app.kind for app in one.apps] for one in (first, second))
    found = []
    for way, i0, i1, j0, j1 in SequenceMatcher(None, kinds, others, autojunk=False).get_opcodes():
        for i, j in zip_longest(range(i0, i1), range(j0, j1)):
            one = None if i is None else first.apps[i]
            other = None if j is None else second.apps[j]
            found.append(Difference(_named(i, one), _named(j, other), _words(one, other, way, limits)))
    return found


def _named(index: int | None, app: App | None) -> str:
    return "" if index is None or app is None else f"{index + 1} · {APP_KINDS[app.kind].title}"


def _words(one: App | None, other: App | None, way: str, limits: DifferenceLimits) -> str:
    if one is None:
        return SECOND_ALONE
    if other is None:
        return FIRST_ALONE
    found = [] if way == "equal" else [ANOTHER]
    return "; ".join([*found, *_compared(one, other, limits)]) or ALIKE


def _compared(one: App, other: App, limits: DifferenceLimits) -> Iterator[str]:
    if one.target is not None and other.target is not None:
        apart = math.dist(one.target, other.target)
        if apart >= limits.target_m:
            yield f"target {1000 * apart:.0f} mm away"
    values = (
        ("force", _length(one.force), _length(other.force), limits.force_n, 1.0, "N", 1),
        ("load", one.load_kg, other.load_kg, limits.load_kg, 1.0, "kg", 2),
        ("gripper", one.gripper_width, other.gripper_width, limits.width_m, 1000.0, "mm", 0),
        ("takes", one.tn - one.t0, other.tn - other.t0, limits.duration_s, 1.0, "s", 1),
    )
    for name, before, after, limit, scale, unit, digits in values:
        if _differ(before, after, limit, limits.share):
            shown = (
                "none" if value is None else f"{scale * value:.{digits}f} {unit}" for value in (before, after)
            )
            yield f"{name} {' and '.join(shown)}"


def _differ(before: float | None, after: float | None, limit: float, share: float) -> bool:
    if before is None or after is None:
        return before is not after
    return abs(after - before) >= max(limit, share * max(abs(before), abs(after)))


def _length(force: Vector | None) -> float | None:
    return None if force is None else math.hypot(*force)
