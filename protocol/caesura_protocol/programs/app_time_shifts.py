"""The times of apps: shifted, scaled, and recomputed after an operator changed order or speed.

An app that begins earlier than taught keeps every duration to the last bit. Its times are shifted by a
multiple of `SHIFT_S`, and a float that gets smaller by that is exact.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from operator import itemgetter
from typing import NamedTuple, TypeVar

from caesura_protocol.app_contacts import ends_in_contact, is_resisted
from caesura_protocol.app_kinds import APP_KINDS
from caesura_protocol.messages import App, AppPath, DeleteApp, Gap, ProgramEdit, ReplacePart, Vector
from caesura_protocol.reproduced_path import turn_of

SHIFT_S = 2.0**-20
TURNED_M = 0.1  # a turn by a radian counts as so many metres
EVEN_S = 1e-6  # by which two times may differ and be the same
AT_ONCE_S, SAME_M = 1e-3, 1e-3  # a pause that is none; apart that two places may be and are the same

PLACED = frozenset({"place", "added", "taught_again"})  # marks of an app that stands where it was not taught

A = TypeVar("A", bound=App)
Taught = tuple[int | None, float]  # the edit that added an app, and when it began [s]


def may_retime(app: App) -> bool:
    """Whether an app moves in free space or carries, along a path that is no turn in place.

    What pushes or pulls against a resistance keeps its speed: a box that is pushed faster may slide on.
    """
    moves = APP_KINDS[app.kind].travels and not is_resisted(app)
    if not moves or app.path is None or app.target is None or app.screw is not None:
        return False
    return app.path.length_m > TURNED_M * turn_of(app)


def speed_in_words(app: App) -> str:
    """Return the speed that an operator set for an app as text, in per cent of the taught one; else empty."""
    return "" if app.speed is None else f"{100 * app.speed:.3g} % of the taught one"


def part_of(app: App) -> int | None:
    """Return the number of the edit that inserted an app of another session; None for every other app."""
    return next((mark.edit for mark in app.changes if mark.field == "taught_again"), None)


def is_taught_again(app: App) -> bool:
    """Return whether an app comes from another session and replaces a part."""
    return part_of(app) is not None


def moved(path: AppPath, when: Callable[[float], float], faster: float = 1.0) -> AppPath:
    """Return the path at other times. when: maps its times [s]; faster: factor of its velocities."""
    start, *via = (
        point.model_copy(
            update={
                "t": when(point.t),
                "velocity": _times(faster, point.velocity),
                "angular_velocity": _times(faster, point.angular_velocity),
            }
        )
        for point in (path.start, *path.via)
    )
    ends = {
        "end_velocity": _times(faster, path.end_velocity),
        "end_angular_velocity": _times(faster, path.end_angular_velocity),
    }
    return path.model_copy(update={"start": start, "via": tuple(via), "tn": when(path.tn), **ends})


def goes_on(app: App, following: App | None) -> bool:
    """Return whether the next app continues in the air where and when an app has arrived, without a rest."""
    if following is None or app.path is None or following.path is None or app.target is None:
        return False
    in_air = APP_KINDS[app.kind].has_target and APP_KINDS[following.kind].has_target
    at_once = abs(following.path.start.t - app.path.tn) < AT_ONCE_S
    there = math.dist(app.target, following.path.start.position) < SAME_M
    return in_air and at_once and there and not ends_in_contact(app, following)


def rests_of(app: App) -> tuple[float, float]:
    """Return the times [s] that an app rests in contact before and after its path; 0 without a path."""
    if app.path is None:
        return 0.0, 0.0
    before_s = max(app.path.start.t - app.t0, 0.0)
    return before_s, max(app.tn - app.t0 - before_s - (app.path.tn - app.path.start.t), 0.0)


def run_times(app: App) -> tuple[float, float]:
    """Return the times [s] at which a run app begins and ends: with its path and its rests in contact.

    A path leads from observation to observation, and to where a contact was made.
    """
    if app.path is None:
        return app.t0, app.tn
    begun, ended = app.path.start.t, app.path.tn
    return (begun, ended) if APP_KINDS[app.kind].has_target else (min(app.t0, begun), max(app.tn, ended))


def rest_newtons(app: App) -> tuple[float, float]:
    """Return the forces [N] of an app's rests before and after its path; by default that on the path."""
    newtons = 0.0 if app.force is None else math.hypot(*app.force)
    before, after = (newtons if rest is None else rest.newton for rest in (app.rest_before, app.rest_after))
    return before, after


def _times(factor: float, vector: Vector | None) -> Vector | None:
    return None if vector is None else (factor * vector[0], factor * vector[1], factor * vector[2])


def earlier(app: A, shift_s: float) -> A:
    """Return the app with all its times `shift_s` earlier; the same object for 0 s."""
    if shift_s == 0.0:
        return app
    path = None if app.path is None else moved(app.path, lambda t: t - shift_s)
    return app.model_copy(update={"t0": app.t0 - shift_s, "tn": app.tn - shift_s, "path": path})


def scaled(app: A, factor: float) -> A:
    """Return the app at a factor of its speed, from the same time on."""

    def when(t: float) -> float:
        return app.t0 + (t - app.t0) / factor

    path = None if app.path is None else moved(app.path, when, factor)
    return app.model_copy(update={"tn": when(app.tn), "path": path})


class EditedTimes(NamedTuple):
    """Apps and gaps at the times of the edited program. Gaps are those within an app.

    follows: whether each app follows the one before it as when they were taught; True for the first.
    """

    apps: tuple[App, ...]
    gaps: tuple[Gap, ...]
    follows: tuple[bool, ...]


def edited_times(
    apps: Sequence[App], gaps: Sequence[Gap], edits: Sequence[ProgramEdit]
) -> EditedTimes | None:
    """Return the apps one after the other at their speeds; None if no edit changes order or speed.

    A pause is kept where its two apps followed each other when they were taught; elsewhere there is none.
    """
    deleted = [place for edit in edits if edit.state == "applied" for place in _left_out(edit)]
    if not deleted and not any(map(_is_elsewhere, apps)):
        return None
    taught: dict[int | None, list[float]] = {}  # when apps began [s], in order, by the edit that added them
    for added, t0 in sorted((*deleted, *((app.added, app.t0) for app in apps)), key=itemgetter(1)):
        taught.setdefault(added, []).append(t0)
    made: list[App] = []
    missing: list[Gap] = []
    follows = (True, *(_followed(before, app, taught) for before, app in pairwise(apps)))
    for index, app in enumerate(apps):
        before = apps[index - 1] if index else None
        pause_s = app.t0 - before.tn if before and follows[index] else 0.0
        t0 = made[-1].tn + pause_s if made else min(one.t0 for one in apps)
        shifted = earlier(app, math.floor((app.t0 - t0) / SHIFT_S) * SHIFT_S)
        made.append(shifted if app.speed is None else scaled(shifted, app.speed))
        missing += () if is_taught_again(app) else _gaps_within(app, made[-1], gaps)
    return EditedTimes(tuple(made), tuple(missing), follows)


def _is_elsewhere(app: App) -> bool:
    """Return whether an edit changed an app's place or its speed."""
    return app.speed is not None or any(mark.field in PLACED for mark in app.changes)


def _left_out(edit: ProgramEdit) -> list[Taught]:
    """Return the apps that an edit names and removes."""
    match edit.action:
        case DeleteApp(app=app):
            return [(app.added, app.t0)]
        case ReplacePart(first=first, last=last):
            return [(first.added, first.t0), (last.added, last.t0)]
        case _:
            return []


def _followed(before: App, app: App, taught: Mapping[int | None, Sequence[float]]) -> bool:
    """Return whether an app directly followed another one when they were taught."""
    if before.added != app.added or app.t0 < before.tn:
        return False
    starts = taught[app.added]
    first, last = bisect_left(starts, before.tn - EVEN_S), bisect_left(starts, app.t0 - EVEN_S)
    return all(t == before.t0 for t in starts[first:last])


def _gaps_within(app: App, made: App, gaps: Sequence[Gap]) -> list[Gap]:
    """Return the gaps of an app at its new times."""
    if app.tn <= app.t0:
        return []
    pace = (made.tn - made.t0) / (app.tn - app.t0)
    inside = ((max(gap.t0, app.t0), min(gap.tn, app.tn), gap.reason) for gap in gaps)
    return [
        Gap(t0=made.t0 + pace * (t0 - app.t0), tn=made.t0 + pace * (tn - app.t0), reason=reason)
        for t0, tn, reason in inside
        if t0 < tn
    ]
