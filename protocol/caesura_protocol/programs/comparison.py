"""Two programs compared app by app, in words: what the first has that the second has not, and the reverse."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

from caesura_protocol.app_kinds import app_number, app_title
from caesura_protocol.messages import App
from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.rotations import angle_between

LEAST_M, LEAST_RAD, LEAST_N = 1e-4, math.radians(0.1), 0.05  # differences below these are none
ALONE, FAR_M = 0.7, 0.1  # cost of an app that only one has; targets this far apart cost 1
LEAST_S, LEAST_KG, LEAST_FACTOR = 0.005, 0.005, 0.005


def differences(one: ProgramFile, other: ProgramFile) -> list[str]:
    """Return the differences of a program from another one, app by app; none for equal ones."""
    found = [f"program: {words}" for words in _of_programs(one, other)]
    for first, second in _pairs(one.apps, other.apps):
        if second is None and first is not None:
            found.append(f"{_named(one.apps, first)} is added")
        elif first is None and second is not None:
            found.append(f"without {_named(other.apps, second)}")
        elif first is not None and second is not None:
            words = "; ".join(_of_apps(one.apps[first], other.apps[second]))
            found += [f"{_named(one.apps, first)}: {words}"] if words else []
    return found


def _pairs(apps: Sequence[App], others: Sequence[App]) -> list[tuple[int | None, int | None]]:
    """Return the apps that belong together, in order, at the least cost; None beside an app without another.

    As an edit distance: a pair of one kind costs what its targets are apart, an app alone `ALONE`.
    """
    cost = [[ALONE * j for j in range(len(others) + 1)]]
    for i, app in enumerate(apps, start=1):
        row = [ALONE * i]
        for j, other in enumerate(others, start=1):
            together = cost[i - 1][j - 1] + _apart(app, other)
            row.append(min(together, cost[i - 1][j] + ALONE, row[-1] + ALONE))
        cost.append(row)
    i, j = len(apps), len(others)
    pairs: list[tuple[int | None, int | None]] = []
    while i or j:
        if i and j and cost[i][j] == cost[i - 1][j - 1] + _apart(apps[i - 1], others[j - 1]):
            i, j = i - 1, j - 1
            pairs.append((i, j))
        elif i and cost[i][j] == cost[i - 1][j] + ALONE:
            i -= 1
            pairs.append((i, None))
        else:
            j -= 1
            pairs.append((None, j))
    return pairs[::-1]


def _apart(app: App, other: App) -> float:
    """What it costs to take two apps for the same one; 0 for the same target, infinite for another kind."""
    if app.kind != other.kind:
        return math.inf
    if app.target is None or other.target is None:
        return 0.0 if app.target == other.target else 1.0
    return min(1.0, math.dist(app.target, other.target) / FAR_M)


def _named(apps: Sequence[App], index: int) -> str:
    app = apps[index]
    name = f" '{app.name}'" if app.name else ""
    return f"app {app_number(index)}{name} ({app_title(app.kind)})"


def _of_programs(one: ProgramFile, other: ProgramFile) -> Iterator[str]:
    for what, mine, others in (
        ("name", one.name, other.name),
        ("robot", one.robot, other.robot),
        ("force limit [N]", one.safety.force_n, other.safety.force_n),
    ):
        if mine != others:
            yield f"{what} {_or_none(mine)}, was {_or_none(others)}"


def _of_apps(one: App, other: App) -> Iterator[str]:
    for what, text, before in (("name", one.name, other.name), ("note", one.note, other.note)):
        if text != before:
            yield f"{what} {_or_none(text)}, was {_or_none(before)}"
    yield from _of_poses(one, other)
    for what, value, least, unit, scale in _NUMBERS:
        mine, others = value(one), value(other)
        if mine != others and (mine is None or others is None or abs(mine - others) >= least):
            yield f"{what} {_number(mine, unit, scale)}, was {_number(others, unit, scale)}"


def _of_poses(one: App, other: App) -> Iterator[str]:
    if one.target is not None and other.target is not None:
        apart = math.dist(one.target, other.target)
        if apart >= LEAST_M:
            yield f"target {1000 * apart:.1f} mm away"
    elif one.target != other.target:
        yield "target given" if one.target else "no target any more"
    if one.orientation is not None and other.orientation is not None:
        turned = angle_between(one.orientation, other.orientation)
        if turned >= LEAST_RAD:
            yield f"turned by {math.degrees(turned):.1f}°"


def _size(app: App) -> float | None:
    return None if app.force is None else math.hypot(*app.force)


_Number = tuple[str, Callable[[App], float | None], float, str, float]  # with its least difference and unit
_NUMBERS: Sequence[_Number] = (
    ("force", _size, LEAST_N, "N", 1.0),
    ("duration", lambda app: app.tn - app.t0, LEAST_S, "s", 1.0),
    ("speed", lambda app: app.speed or 1.0, LEAST_FACTOR, "%", 100.0),
    ("gripper width", lambda app: app.gripper_width, LEAST_M, "mm", 1000.0),
    ("load", lambda app: app.load_kg, LEAST_KG, "kg", 1.0),
    ("path", lambda app: None if app.path is None else app.path.length_m, 10 * LEAST_M, "mm", 1000.0),
    ("tolerance", lambda app: None if app.path is None else app.path.tolerance_m, LEAST_M, "mm", 1000.0),
)


def _number(value: float | None, unit: str, scale: float) -> str:
    return "not given" if value is None else f"{scale * value:.4g} {unit}"


def _or_none(value: object) -> str:
    return "none" if value is None else f"{value}" if isinstance(value, float) else f"'{value}'"
