"""Checks each app separately: numbers that are finite, and within the limits that need no geometry."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from caesura_protocol.app_force_limit import LEAST_PRESS_N, ExertedForce, exerted_forces
from caesura_protocol.app_kinds import APP_KINDS
from caesura_protocol.messages import JOINTS_MOST, App, AppPath, ViaPoint
from caesura_protocol.number_words import fixed, reads_above
from caesura_protocol.programs.checks.findings import Finding, Remedy
from caesura_protocol.programs.safety import Safety

NUMBERS = (
    "t0",
    "tn",
    "target",
    "orientation",
    "joints",
    "force",
    "force_taught",
    "load_kg",
    "load_sd_kg",
    "gripper_width",
    "weaker_n",
    "stronger_n",
    "impact_n",
    "aslant",
    "moved_m_per_s",
    "turned_rad_per_s",
    "confidence",
)
TIMES = ("t", "t0", "tn")
WIDTHS = {
    "target": (3,),
    "orientation": (4,),
    "joints": range(1, JOINTS_MOST + 1),
    "force": (3,),
    "force_taught": (3,),
    "aslant": (3,),
}
NUMBERS_OF_PATH = ("tn", "end_velocity", "end_angular_velocity", "length_m", "deviation_m", "deviation_rad")
WIDTHS_OF_PATH = {
    "position": (3,),
    "orientation": (4,),
    "velocity": (3,),
    "angular_velocity": (3,),
    "end_velocity": (3,),
    "end_angular_velocity": (3,),
}
NUMBERS_OF_POINT = ("t", "position", "orientation", "velocity", "angular_velocity")
NUMBERS_OF_SCREW = ("axis", "point", "angle", "pitch_m", "pitch_sd_m", "torque")
WIDTHS_OF_SCREW = {"axis": (3,), "point": (3,), "torque": (3,)}
ONE = (1,)
LEAST_S = 0.1
ABSURD = 1e6  # no number of a program is larger, whatever its unit
LATEST_S = 1e10  # but a time, which may be one of day
UNIT_TOLERANCE = 0.05  # of a quaternion's length
WIDTH_TOLERANCE_M = 0.005  # fingers that are wide open say a little more than they open
FORCE_TOLERANCE_N = 1e-6
LESS_FORCE = Remedy(
    ". Raise that with --cell, or limit the force with --force-limit",
    ". Set a smaller force at this app, or raise that limit of the cell where the program is run",
)


def value_findings(apps: Sequence[App], safety: Safety) -> list[Finding]:
    """Find numbers of each app that are missing, not finite or out of range."""
    found: list[Finding] = []
    for index, app in enumerate(apps):
        wrong = list(absurd_numbers(index, app))
        found += wrong or [
            *_missing(index, app),
            *_out_of_range(index, app, safety),
            *_repeated_times(index, app),
        ]
    for index, (before, app) in enumerate(pairwise(apps), start=1):
        if app.t0 < before.t0:
            earlier = f"expected after the start of the app before it, {fixed(before.t0, 2)} s"
            reason = f"begins at {fixed(app.t0, 2)} s, {earlier}"
            found.append(Finding("error", index, app.kind, reason, app.t0, before.t0))
    return [*found, *(beyond_stop(apps, safety) if are_numbers_finite(apps) else ())]


def are_numbers_finite(apps: Sequence[App]) -> bool:
    """Whether every number of the apps is finite, and every vector complete."""
    return not any(True for index, app in enumerate(apps) for _ in absurd_numbers(index, app))


def impossible_numbers(index: int, app: App) -> Iterator[Finding]:
    """Yield an error for each number that an app has in no cell.

    Beyond absurd numbers these are times that go back, a load or a width below 0, and an orientation or an
    axis that is not of length 1. index: of the app in its program, from 0.
    """
    wrong = list(absurd_numbers(index, app))
    yield from wrong or (*_repeated_times(index, app), *_beyond(index, app, _ranges_of_any_cell(app)))


def absurd_numbers(index: int, app: App) -> Iterator[Finding]:
    """Yield an error for each number of an app that is not finite, or larger than any, and for each vector of
    another length.

    index: of the app in its program, from 0.
    """
    given: list[tuple[str, Any, Sequence[int]]] = [
        (name, getattr(app, name), WIDTHS.get(name, ONE)) for name in NUMBERS
    ]
    if app.screw is not None:
        numbers = ((name, WIDTHS_OF_SCREW.get(name, ONE)) for name in NUMBERS_OF_SCREW)
        given += [(f"screw.{name}", getattr(app.screw, name), widths) for name, widths in numbers]
    rests = (("rest_before", app.rest_before), ("rest_after", app.rest_after))
    given += [(f"{name}.newton", rest.newton, ONE) for name, rest in rests if rest is not None]
    if app.path is not None:
        parts: list[tuple[str, AppPath | ViaPoint, Sequence[str]]] = [("path", app.path, NUMBERS_OF_PATH)]
        parts += [(place, point, NUMBERS_OF_POINT) for place, point in _points(app.path)]
        given += [
            (f"{place}.{name}", getattr(part, name), WIDTHS_OF_PATH.get(name, ONE))
            for place, part, names in parts
            for name in names
        ]
    for name, value, widths in given:
        if value is None:
            continue
        try:
            values = np.asarray(value, dtype=np.float64).ravel()
        except (TypeError, ValueError):
            values = np.full(1, np.nan)
        most = LATEST_S if name.rpartition(".")[2] in TIMES else ABSURD
        if values.size not in widths or not (np.abs(values) < most).all():
            many = "a number" if widths == ONE else f"{' to '.join(map(str, _ends(widths)))} numbers"
            expected = f"{many}, finite and below {most:g}"
            yield Finding("error", index, app.kind, f"{name} is {value!r:.100}, expected {expected}")


def _points(path: AppPath) -> Iterator[tuple[str, ViaPoint]]:
    """Yield the points of a path that a file states, with their places in it."""
    yield "path.start", path.start
    for number, point in enumerate(path.via):
        yield f"path.via.{number}", point


def _ends(widths: Sequence[int]) -> tuple[int, ...]:
    """Return the least and the largest of some counts, or one number if they are equal."""
    return tuple(dict.fromkeys((widths[0], widths[-1])))


def _missing(index: int, app: App) -> Iterator[Finding]:
    for name in APP_KINDS[app.kind].needs:
        if getattr(app, name) is None:
            yield Finding("error", index, app.kind, f"has no {name}")


def _repeated_times(index: int, app: App) -> Iterator[Finding]:
    """Yield an error for each point of a path that is no later than the one before."""
    if app.path is None:
        return
    times = [app.path.start.t, *(point.t for point in app.path.via), app.path.tn]
    for before, t in pairwise(times):
        if not before < t < np.inf:
            reason = f"its path has a point at {t:g} s, expected after the point before it at {before:g} s"
            yield Finding("error", index, app.kind, reason, t, before)


def _out_of_range(index: int, app: App, safety: Safety) -> Iterator[Finding]:
    """Yield an error for each number beyond its limits, and a warning for a low confidence."""
    yield from _beyond(index, app, (*_ranges(app, safety), *_press_ranges(app, safety)))
    if reads_above(safety.least_confidence, app.confidence, 2):
        percent, least = 100.0 * app.confidence, 100.0 * safety.least_confidence
        reason = f"confidence {percent:.0f} % is below {least:g} %: check this app before a run"
        yield Finding("warning", index, app.kind, reason, app.confidence, safety.least_confidence)


class _Range(NamedTuple):
    """A number with the limits between which it must lie."""

    name: str
    value: float
    least: float
    most: float
    unit: str


def _beyond(index: int, app: App, ranges: Iterable[_Range]) -> Iterator[Finding]:
    """Yield an error for each number that is out of its range."""
    for what in ranges:
        if not what.least <= what.value <= what.most:
            limit = what.least if what.value < what.least else what.most
            unit = f" {what.unit}" if what.unit else ""
            scale = 1000.0 if what.unit == "mm" else 1.0
            reason = (
                f"{what.name} {scale * what.value:.4g}{unit}, "
                f"expected {scale * what.least:g} to {scale * what.most:g}{unit}"
            )
            yield Finding("error", index, app.kind, reason, what.value, limit)


def _ranges(app: App, safety: Safety) -> Iterator[_Range]:
    least_s = LEAST_S if APP_KINDS[app.kind].needs else 0.0
    yield _Range("duration", app.tn - app.t0, least_s, safety.duration_s, "s")
    yield _Range("confidence", app.confidence, 0.0, 1.0, "")
    if app.load_kg is not None:
        yield _Range("load", app.load_kg, 0.0, safety.load_kg, "kg")
    if app.gripper_width is not None:
        widest = safety.gripper_width_m + WIDTH_TOLERANCE_M
        yield _Range("gripper width", app.gripper_width, 0.0, widest, "mm")
    yield from _lengths(app)


def _ranges_of_any_cell(app: App) -> Iterator[_Range]:
    """Yield the numbers whose least value, or whose length, is the same in every cell."""
    yield _Range("duration", app.tn - app.t0, 0.0, np.inf, "s")
    if app.load_kg is not None:
        yield _Range("load", app.load_kg, 0.0, np.inf, "kg")
    if app.gripper_width is not None:
        yield _Range("gripper width", app.gripper_width, 0.0, np.inf, "mm")
    yield from _lengths(app)


def _lengths(app: App) -> Iterator[_Range]:
    """Yield the lengths of quaternions and axes, which are 1."""
    if app.orientation is not None:
        length = float(np.linalg.norm(app.orientation))
        yield _Range("length of the orientation", length, 1.0 - UNIT_TOLERANCE, 1.0 + UNIT_TOLERANCE, "")
    for place, point in () if app.path is None else _points(app.path):
        if point.orientation is not None:
            length = float(np.linalg.norm(point.orientation))
            name = f"length of {place}.orientation"
            yield _Range(name, length, 1.0 - UNIT_TOLERANCE, 1.0 + UNIT_TOLERANCE, "")
    if app.screw is not None:
        length = float(np.linalg.norm(app.screw.axis))
        yield _Range("length of the turn's axis", length, 1.0 - UNIT_TOLERANCE, 1.0 + UNIT_TOLERANCE, "")


def _press_ranges(app: App, safety: Safety) -> Iterator[_Range]:
    least_n = LEAST_PRESS_N if APP_KINDS[app.kind].presses else 0.0
    most_n = np.inf if safety.force_n is None else safety.force_n
    for force in exerted_forces(app):
        if abs(force.newton - most_n) > FORCE_TOLERANCE_N:
            yield _Range(_name_of(force), force.newton, least_n, most_n, "N")


def beyond_stop(apps: Sequence[App], safety: Safety) -> Iterator[Finding]:
    """Yield a warning on the largest force of each app with which the robot would be stopped."""
    most, stops = safety.most_felt_n, safety.felt_force_n
    for index, app in enumerate(apps):
        force = max(exerted_forces(app), key=lambda one: one.newton, default=None)
        if force is not None and force.newton > most + FORCE_TOLERANCE_N:
            reason = (
                f"{_name_of(force)} {fixed(force.newton, 1)} N is above {fixed(most, 1)} N: the robot is "
                f"stopped at {stops:g} N (felt_force_n), so this app is not started"
            )
            yield LESS_FORCE.of(Finding("warning", index, app.kind, reason, force.newton, most))


def _name_of(force: ExertedForce) -> str:
    return f"force {force.when} its path" if force.when else "force"
