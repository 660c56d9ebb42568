"""The truth of a simulated demonstration, in the format of the hand annotations of real recordings.

Derived from the simulated state, never from the plan: contact from the contact model, motion from the true
speed, a load from what the fingers held off the ground. The rule is the annotators': a rest of at least 0.3 s
parts two movements, shorter ones and small corrections are optional (neither a miss nor a false alarm).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from scipy.ndimage import uniform_filter1d

from caesura_lab.teacher.contact_and_motion_spans import (
    REST_S,
    SMOOTH_S,
    START_M_PER_S,
    SURE_M_PER_S,
    TOUCH_N,
    Class,
    TickSpan,
    TrueState,
    contact_spans,
    largest_distance,
    runs,
    smooth,
    spans_of,
)
from caesura_lab.teacher.motion_profiles import Array
from caesura_lab.teacher.speed_dip_truth import SMALL_M, guided_dips, ideal_dips

Level = Literal["major", "optional"]
MOVING = ("motion", "transport", "sliding", "turning")
RESTS_OF: Mapping[Class, tuple[Class, ...]] = {
    "motion": ("steady",),
    "transport": ("hold",),
    "sliding": ("contact",),
    "turning": ("steady", "hold", "contact"),
}

RULE = (
    "from the simulation's true state: major = boundary between motion and a rest that lasts >=0.3 s; "
    "contact on or off; or a >45 deg change of direction through a clear speed dip. optional = speed dips, "
    "corrections below 25 mm/s or 10 mm, begin of a force's decay, fingers, a turn or stop within tol of a "
    "contact's begin or end: score neither as miss nor as false alarm. Motion starts and stops at 5 mm/s. "
    "tol = reading uncertainty, as in hand annotations."
)
TOL_S, CORNER_TOL_S = 0.15, 0.2
NEAR_S = 0.25  # of two events that are nearer only the clearer one counts
DECAY_BEGINS = 0.8  # of the force before
PLATEAU_SHARE = 0.7  # of the force that a tenth of the contact exceeds
DECAY_LEAST_S = 0.1
DECAY_MOST_S = 1.0  # a force that decays for longer does not belong to a release


GUIDED_RULE = (
    RULE.replace(
        "Motion starts and stops at 5 mm/s.", "Motion starts and stops at 10 mm/s, and creep below is rest."
    )
    + " In contact motion is read along any direction. Tracing, slower than 25 mm/s and longer than 12 mm, is"
    " motion from 4 mm/s on. Where it is below 5 mm/s for 0.3 s, a pause is optional, and a start or stop is"
    " accepted at either end. A pause below 0.3 s, a rest that is never below 5 mm/s for 0.3 s, a corner with"
    " less than 10 mm beside it, one within 0.25 s of a start or stop, and one whose two readings do not both"
    " exceed 50 deg are optional. A gradual edge has a wider tol, up to 0.4 s."
    " A release that lasts is accepted at either end. A rest that a contact, or an end of the recording,"
    " cuts to less than 0.3 s has an optional edge."
)
TURNING_RULE = (
    " A turn is read as the speed that it gives a point at 0.1 m: it starts and stops at 0.1 rad/s. turning ="
    " the tool's tip travels less than a quarter of that point's way; what travels and turns is motion,"
    " transport or sliding. Speed is the tip's, in contact along any direction. Edges within 0.3 s are one. A"
    " reversal of a turn is a corner."
)
EDGE_TOL_S = 0.4  # largest tolerance of a gradual edge


def annotate(state: TrueState, *, guided: bool = False) -> dict[str, Any]:
    """Changepoints, segments, loads, forces and gripper events of a demonstration, ready for JSON.

    guided: read movements of people with habits, which creep and trace; ideal ones do neither.
    """
    contacts = contact_spans(state)
    spans = spans_of(state, contacts, guided=guided)
    marks = _boundaries(state, spans, contacts)
    presses = [contact for contact in contacts if _is_pressed(state, *contact)]
    decays = _decays(state, presses)
    if guided:
        marks = [_with_edge(state, mark) for mark in _beside_rests(state, spans, marks)]
        speed = smooth(state.reference_speed, state.dt)
        spans, marks = _without_doubtful_rests(state, speed, spans, marks)
        marks = _with_doubtful_pauses(state, speed, spans, marks)
        marks += _cut_rests(state, spans)
        _accept_both_ends(marks, decays)
    marks += decays + _within_motions(state, spans, guided=guided)
    gripper = _gripper(state)
    marks += [_mark(event["t"], "optional", str(event["event"])) for event in gripper]
    marks = _without_coincident(marks, corners_too=guided)
    return {
        "window": [0.0, _time(state, state.t.size - 1)],
        "rule": (GUIDED_RULE if guided else RULE) + TURNING_RULE * state.turns,
        "changepoints": sorted(marks, key=lambda mark: (mark["t"], mark["level"])),
        "segments": [
            {"t0": _time(state, s.first), "t1": _time(state, s.last), "cls": s.cls}
            for s in spans
            if not s.small and s.clear
        ],
        "gripper": gripper,
        "loads": _loads(state, spans),
        "forces": [_force(state, first, last) for first, last in presses],
    }


def _boundaries(
    state: TrueState, spans: list[TickSpan], contacts: list[tuple[int, int]]
) -> list[dict[str, Any]]:
    on, off = {a for a, _ in contacts}, {b for _, b in contacts}
    marks = []
    for before, after in pairwise(spans):
        edge = "contact_on" if after.first in on else "contact_off" if after.first in off else None
        level: Level = "major" if edge or _large(before) or _large(after) else "optional"
        starts = _large(after) or (after.small and not _large(before))
        kind = edge or ("start" if starts else "stop")
        marks.append(_mark(_time(state, after.first), level, kind))
    return marks


def _large(span: TickSpan) -> bool:
    return span.cls in MOVING and not span.small


def _beside_rests(
    state: TrueState, spans: list[TickSpan], marks: list[dict[str, Any]]
) -> list[dict[str, Any]]:
    """Mark a start or stop beside a small movement as optional, unless a rest lies beyond the small one.

    Where one does, the tolerance covers the small movement. marks: one for each pair of spans in a row.
    """
    marked = []
    for index, (mark, (before, after)) in enumerate(zip(marks, pairwise(spans), strict=True)):
        small = before if before.small else after if after.small else None
        beyond = spans[max(0, index - 1)] if before.small else spans[min(index + 2, len(spans) - 1)]
        if small is None or mark["level"] != "major" or mark["kind"] not in ("start", "stop"):
            marked.append(mark)
        elif beyond is not small and beyond.cls not in RESTS_OF[small.cls]:
            marked.append({**mark, "level": "optional"})
        else:
            covered = (small.last - small.first) * state.dt
            marked.append({**mark, "tol": round(min(EDGE_TOL_S, max(mark["tol"], covered)), 3)})
    return marked


def _with_edge(state: TrueState, mark: dict[str, Any]) -> dict[str, Any]:
    """Widen the tolerance of a start or stop to the time that the speed spends between 5 and 10 mm/s."""
    if mark["kind"] not in ("start", "stop"):
        return mark
    tick, look = round(mark["t"] / state.dt), round(EDGE_TOL_S / state.dt)
    near = slice(max(0, tick - look), tick + look)
    speed = state.reference_speed[near]
    gradual = float(np.sum((speed > START_M_PER_S) & (speed < SURE_M_PER_S)) * state.dt)
    return {**mark, "tol": round(min(EDGE_TOL_S, max(mark["tol"], gradual)), 3)}


def _without_doubtful_rests(
    state: TrueState, speed: Array, spans: list[TickSpan], marks: list[dict[str, Any]]
) -> tuple[list[TickSpan], list[dict[str, Any]]]:
    """Leave open what is a rest by one reading only: below 10 mm/s, but never below 5 mm/s for 0.3 s.

    Such a span has no class, and a start or stop beside it is optional. In contact a press may move the hand.
    speed: (n,) [m/s], smoothed; marks: one for each pair of spans.
    """
    spans = [s._replace(clear=s.cls not in ("steady", "hold") or _is_rest(speed, s, state.dt)) for s in spans]
    marks = [
        mark if (before.clear and after.clear) or mark["kind"] not in ("start", "stop") else _optional(mark)
        for mark, (before, after) in zip(marks, pairwise(spans), strict=True)
    ]
    return spans, marks


def _with_doubtful_pauses(
    state: TrueState, speed: Array, spans: list[TickSpan], marks: list[dict[str, Any]]
) -> list[dict[str, Any]]:
    """Leave open what is movement by one reading only: traced, but below 5 mm/s for 0.3 s.

    Inside of a movement the edges of such a pause are optional. Where less than a correction parts it from
    the movement's start or stop, either end is accepted. speed: (n,) [m/s], smoothed; marks: one for each
    pair of spans.
    """
    marks, pauses = [dict(mark) for mark in marks], []
    for index, span in enumerate(spans):
        if not _large(span):
            continue
        for first, last in runs(speed[span.first : span.last] < START_M_PER_S):
            if (last - first) * state.dt < REST_S:
                continue
            begun, ended = span.first + first, span.first + last
            if _is_correction(state, span.first, begun):
                _accept(marks[max(index - 1, 0) : index], "start", _time(state, ended))
            elif _is_correction(state, ended, span.last):
                _accept(marks[index : index + 1], "stop", _time(state, begun))
            else:
                pauses.append(_mark(_time(state, begun), "optional", "stop"))
                pauses.append(_mark(_time(state, ended), "optional", "start"))
    return marks + [_with_edge(state, pause) for pause in pauses]


def _is_correction(state: TrueState, first: int, last: int) -> bool:
    """Whether ticks of a movement move the tip less than any movement does."""
    return first == last or largest_distance(state.velocity[first:last], state.dt) < SMALL_M


def _accept(marks: Sequence[dict[str, Any]], kind: str, t: float) -> None:
    """Accept another time [s] for marks of a kind."""
    for mark in marks:
        if mark["kind"] == kind:
            mark["t_alt"] = t


def _is_rest(speed: Array, span: TickSpan, dt: float) -> bool:
    """Return whether a rest also holds by the lower threshold; the recording's ends may cut it."""
    slow = runs(speed[span.first : span.last] < START_M_PER_S)
    longest = max((last - first for first, last in slow), default=0)
    return longest >= min(round(REST_S / dt), span.last - span.first)


def _cut_rests(state: TrueState, spans: Sequence[TickSpan]) -> list[dict[str, Any]]:
    """The edges of rests below 0.3 s that a contact, or an end of the recording, cuts: they are optional.

    Such a rest belongs to the movement beside it. Its edge is where the movement passes 10 mm/s.
    """
    marks: list[dict[str, Any]] = []
    for before, span, after in zip([None, *spans], spans, [*spans[1:], None], strict=False):
        if not _large(span):
            continue
        moving = np.flatnonzero(_smoothed_speed(state, span) > SURE_M_PER_S)
        for beside, tick, kind in ((before, moving[:1], "start"), (after, moving[-1:] + 1, "stop")):
            is_cut = beside is None or beside.cls not in RESTS_OF[span.cls]
            if is_cut and tick.size and 0 < tick[0] < span.last - span.first:
                mark = _mark(_time(state, span.first + int(tick[0])), "optional", kind)
                marks.append(_with_edge(state, mark))
    return marks


def _accept_both_ends(marks: Sequence[dict[str, Any]], decays: Sequence[dict[str, Any]]) -> None:
    """Accept a release that lasts at its beginning too, where the force begins to decay."""
    for mark in marks:
        begun = [d for d in decays if 0.0 < mark["t"] - d["t"] < DECAY_MOST_S]
        if mark["kind"] == "contact_off" and begun:
            mark["t_alt"] = begun[-1]["t"]


def _optional(mark: dict[str, Any]) -> dict[str, Any]:
    return {**mark, "level": "optional"}


def _within_motions(state: TrueState, spans: list[TickSpan], *, guided: bool) -> list[dict[str, Any]]:
    """Corners, speed dips and short rests inside of movements."""
    find, marks = guided_dips if guided else ideal_dips, []
    for span in filter(_large, spans):
        for dip in find(_smoothed(state, span, guided=guided), state.dt):
            tol = CORNER_TOL_S if dip.kind == "corner" else TOL_S
            level: Level = "optional" if dip.optional else "major"
            marks.append(_mark(_time(state, span.first + dip.tick), level, dip.kind, tol))
    return marks


def _smoothed_speed(state: TrueState, span: TickSpan) -> Array:
    """(n,) [m/s] by which guided people move in the ticks of a span."""
    velocity = state.velocity_of_class(span.first, span.last, span.cls, guided=True)
    return smooth(np.linalg.norm(velocity, axis=1), state.dt)


def _smoothed(state: TrueState, span: TickSpan, *, guided: bool) -> Array:
    part = state.velocity_of_class(span.first, span.last, span.cls, guided=guided)
    smoothed: Array = uniform_filter1d(part, round(SMOOTH_S / state.dt), axis=0)
    return smoothed


def _without_coincident(marks: list[dict[str, Any]], *, corners_too: bool) -> list[dict[str, Any]]:
    """Make a corner, start or stop optional within reading uncertainty of a contact's beginning or end.

    corners_too: nor is a corner near a start or stop, which is the clearer of the two.
    """
    contacts = [mark["t"] for mark in marks if mark["kind"] in ("contact_on", "contact_off")]
    edges = [m["t"] for m in marks if m["kind"] in ("start", "stop") and m["level"] == "major"]
    edges = edges if corners_too else []

    def beside(mark: dict[str, Any]) -> bool:
        near = any(abs(mark["t"] - t) <= mark["tol"] for t in contacts)
        return near or (mark["kind"] == "corner" and any(abs(mark["t"] - t) < NEAR_S for t in edges))

    return [_optional(m) if m["kind"] in ("corner", "start", "stop") and beside(m) else m for m in marks]


def _decays(state: TrueState, presses: list[tuple[int, int]]) -> list[dict[str, Any]]:
    """Return an optional mark where the force of each press begins to decay for good."""
    marks = []
    for first, last in presses:
        hand_force_n = smooth(state.hand_force_n[first:last], state.dt)
        strong = np.flatnonzero(hand_force_n > DECAY_BEGINS * _plateau(hand_force_n))
        if strong.size and (last - first - strong[-1]) * state.dt > DECAY_LEAST_S:
            marks.append(_mark(_time(state, first + int(strong[-1])), "optional", "decay"))
    return marks


def _is_pressed(state: TrueState, first: int, last: int) -> bool:
    """Whether the hand presses: a load that touches as it is put down may carry itself."""
    return _strong(smooth(state.hand_force_n[first:last], state.dt)) > TOUCH_N


def _plateau(hand_force_n: Array) -> float:
    """Force [N] of the press proper: approach, travel of a button and release left out."""
    return float(np.median(hand_force_n[hand_force_n >= PLATEAU_SHARE * _strong(hand_force_n)]))


def _strong(hand_force_n: Array) -> float:
    """Force [N] that is exceeded for a tenth of the time."""
    return float(np.quantile(hand_force_n, 0.9))


def _force(state: TrueState, first: int, last: int) -> dict[str, float]:
    newton = round(_plateau(state.hand_force_n[first:last]), 2)
    return {"t0": _time(state, first), "t1": _time(state, last), "newton": newton}


def _loads(state: TrueState, spans: list[TickSpan]) -> list[dict[str, float]]:
    carried = np.zeros(state.t.size, dtype=bool)
    for span in spans:
        free = state.load_kg[span.first] > 0.0 and state.normal[span.first] == 0.0
        carried[span.first : span.last] = span.cls in ("transport", "hold") or (
            span.cls == "turning" and free
        )
    return [
        {"t0": _time(state, a), "t1": _time(state, b), "kg": round(float(np.max(state.load_kg[a:b])), 4)}
        for a, b in runs(carried)
    ]


def _gripper(state: TrueState) -> list[dict[str, Any]]:
    held = runs(state.load_kg > 0.0)
    events = [{"t": _time(state, a), "event": "grasp"} for a, _ in held]
    events += [{"t": _time(state, b), "event": "release"} for _, b in held if b < state.t.size]
    return sorted(events, key=lambda event: float(str(event["t"])))


def _mark(t: float, level: Level, kind: str, tol: float = TOL_S) -> dict[str, Any]:
    return {"t": t, "kind": kind, "tol": tol, "level": level}


def _time(state: TrueState, tick: int) -> float:
    return round(tick * state.dt, 3)
