"""What really happened, in the format of the hand annotations of real recordings.

Derived from the simulated state, never from the plan: contact from the contact model, motion from the true
speed, a load from what the fingers held off the ground. The rule is the annotators': a rest of at least 0.3 s
parts two movements, shorter ones and small corrections are optional (neither a miss nor a false alarm).

Where the whole pose is read, an angular rate counts as the speed that it gives a point at a hand's breadth
(0.1 m). So every threshold of the rule holds for turns too: 10 mm/s are 0.1 rad/s.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from caesura_lab.teacher.motion_profiles import Array
from caesura_lab.teacher.speed_dips import SMALL_M, SMALL_M_PER_S, guided_dips, ideal_dips
from caesura_service.constants import GRAVITY

Class = Literal["motion", "steady", "contact", "transport", "hold", "sliding", "turning"]
Level = Literal["major", "optional"]
MOVING = ("motion", "transport", "sliding", "turning")
RESTS_OF: Mapping[Class, tuple[Class, ...]] = {
    "motion": ("steady",),
    "transport": ("hold",),
    "sliding": ("contact",),
    "turning": ("steady", "hold", "contact"),
}
Mask = NDArray[np.bool_]
DistanceMeasure = Callable[[Array, float], float]

RULE = (
    "from the simulation's true state: major = boundary between motion and a rest that lasts >=0.3 s; "
    "contact on or off; or a >45 deg change of direction through a clear speed dip. optional = speed dips, "
    "corrections below 25 mm/s or 10 mm, begin of a force's decay, fingers, a turn or stop within tol of a "
    "contact's begin or end: score neither as miss nor as false alarm. Motion starts and stops at 5 mm/s. "
    "tol = reading uncertainty, as in hand annotations."
)
START_M_PER_S, SURE_M_PER_S = 0.005, 0.010  # motion is above the first, and exceeds the second
REST_S = 0.3
SMOOTH_S = 0.06
SLIDE_S = 0.5  # shorter slips belong to the touching or the letting go
BOUNCE_S = 0.15  # contact lost for less is not lost
TOUCH_S, TOUCH_N = 0.05, 1.0  # contact shorter or weaker is none
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
TRACING_M_PER_S, TRACING_M = 0.004, 0.012  # slow motion of that length is no creep
HAND_BREADTH_M = 0.1  # at which a turn is as fast as a movement
TRAVEL_SHARE = 0.25  # of the way that a turn gives a point at that distance: who travels less turns in place
TURNING_RULE = (
    " A turn is read as the speed that it gives a point at 0.1 m: it starts and stops at 0.1 rad/s. turning ="
    " the tool's tip travels less than a quarter of that point's way; what travels and turns is motion,"
    " transport or sliding. Speed is the tip's, in contact along any direction. Edges within 0.3 s are one. A"
    " reversal of a turn is a corner."
)
EDGE_TOL_S = 0.4  # largest tolerance of a gradual edge


@dataclass(frozen=True)
class TrueState:
    """True state at ticks of equal length: t (n,) [s]; velocity (n, 3) [m/s] of the flange; normal (n,) [N]
    with which a surface pushes; load_kg (n,) between the fingers. Where the whole pose is read, velocity is
    that of the tool's tip and rate (n, 3) [rad/s] that of its turns; else rate is empty.
    """

    t: Array
    velocity: Array
    normal: Array
    load_kg: Array
    rate: Array = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def dt(self) -> float:
        """Length of a tick [s]."""
        return float(self.t[1] - self.t[0])

    @property
    def turns(self) -> bool:
        """Whether turns are read."""
        return bool(len(self.rate))

    @property
    def reference_speed(self) -> Array:
        """(n,) [m/s] speed, or that of a point at a hand's breadth from the tip where it is turned faster."""
        speed = np.linalg.norm(self.velocity, axis=1)
        if not self.turns:
            return np.asarray(speed)
        return np.asarray(np.maximum(speed, HAND_BREADTH_M * np.linalg.norm(self.rate, axis=1)))

    def velocity_of_class(self, first: int, last: int, cls: Class, *, guided: bool) -> Array:
        """Velocity (n, 3) [m/s] by which a class moves in ticks first to last.

        On a level surface that of ideal people is (n, 2): what they push in is a press, and no motion.
        """
        if cls == "turning":
            return np.asarray(HAND_BREADTH_M * self.rate[first:last])
        level = cls == "sliding" and not (self.turns or guided)
        return self.velocity[first:last, : 2 if level else 3]

    @property
    def hand_force_n(self) -> Array:
        """(n,) [N] with which the hand presses: what the surface carries without the load."""
        return self.normal - GRAVITY * self.load_kg


class TickSpan(NamedTuple):
    """Ticks first to last (exclusive) of one class; small ones are corrections.

    clear: an annotator would give it a class.
    """

    first: int
    last: int
    cls: Class
    small: bool = False
    clear: bool = True


def annotate(state: TrueState, *, guided: bool = False) -> dict[str, Any]:
    """Changepoints, segments, loads, forces and gripper events of a demonstration, ready for JSON.

    guided: read movements of people with habits, which creep and trace; ideal ones do neither.
    """
    contacts = contact_spans(state)
    spans = _spans(state, contacts, guided=guided)
    marks = _boundaries(state, spans, contacts)
    presses = [contact for contact in contacts if _is_pressed(state, *contact)]
    decays = _decays(state, presses)
    if guided:
        marks = [_with_edge(state, mark) for mark in _beside_rests(state, spans, marks)]
        speed = _smooth(state.reference_speed, state.dt)
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


def runs(mask: Mask) -> list[tuple[int, int]]:
    """Where a mask holds: first and last (exclusive) tick of each run."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def contact_spans(state: TrueState) -> list[tuple[int, int]]:
    """Ticks in contact: bounces joined, grazes left out."""
    joined: list[tuple[int, int]] = []
    for first, last in runs(state.normal > 0.0):
        if joined and (first - joined[-1][1]) * state.dt < BOUNCE_S:
            joined[-1] = (joined[-1][0], last)
        else:
            joined.append((first, last))
    return [(a, b) for a, b in joined if (b - a) * state.dt > TOUCH_S and state.normal[a:b].max() > TOUCH_N]


def _spans(state: TrueState, contacts: list[tuple[int, int]], *, guided: bool) -> list[TickSpan]:
    """The whole demonstration as consecutive spans."""
    edges = {0, state.t.size, *(e for contact in contacts for e in contact)}
    grip_edges = {e for held in runs(state.load_kg > 0.0) for e in held}
    edges |= {e for e in grip_edges if not any(a <= e < b for a, b in contacts)}
    touching = {first for first, _ in contacts}
    spans: list[TickSpan] = []
    for first, last in pairwise(sorted(edges)):
        held = bool(state.load_kg[first] > 0.0)
        classes: tuple[Class, Class] = ("transport", "hold") if held else ("motion", "steady")
        classes = ("sliding", "contact") if first in touching else classes
        spans += _motion_spans(state, first, last, classes, guided=guided)
    return spans


def _motion_spans(
    state: TrueState, first: int, last: int, classes: tuple[Class, Class], *, guided: bool
) -> list[TickSpan]:
    """Divide a stretch of one contact state into motion and rest."""
    distance_of = _largest_distance if state.turns else _chord_length
    find = partial(_guided_moves if guided else _ideal_moves, distance_of=distance_of)
    velocity = state.velocity_of_class(first, last, classes[0], guided=guided)
    turns = (
        find(*_speed_inputs(state, state.velocity_of_class(first, last, "turning", guided=guided)), "turning")
        if state.turns
        else []
    )
    in_place = [turn for turn in turns if not turn.small and _in_place(state, first, turn)]
    for turn in in_place:
        velocity = velocity.copy()
        velocity[turn.first : turn.last] = 0.0
    moves = find(*_speed_inputs(state, velocity), classes[0])
    if turns:
        moves = _merge_turns(state, moves, turns, in_place)
    at, spans = 0, []
    for move in _join_short_rests(moves, last - first, round(REST_S / state.dt)):
        spans += [TickSpan(at, move.first, classes[1])] * (move.first > at)
        spans.append(move)
        at = move.last
    spans += [TickSpan(at, last - first, classes[1])] * (last - first > at)
    return [s._replace(first=first + s.first, last=first + s.last) for s in spans]


def _speed_inputs(state: TrueState, velocity: Array) -> tuple[Array, Array, float]:
    """Velocity, smoothed speed (n,) [m/s] and tick [s]: what movements are found in."""
    return velocity, _smooth(np.linalg.norm(velocity, axis=1), state.dt), state.dt


def _smooth(values: Array, dt: float) -> Array:
    """Values (n,) at ticks [s], each the mean of those around it."""
    smooth: Array = uniform_filter1d(values, round(SMOOTH_S / dt), mode="nearest")
    return smooth


def _in_place(state: TrueState, first: int, turn: TickSpan) -> bool:
    """Whether the tip hardly travels in a turn of a stretch that begins at a tick."""
    ticks = slice(first + turn.first, first + turn.last)
    turned = state.dt * float(np.linalg.norm(HAND_BREADTH_M * state.rate[ticks], axis=1).sum())
    return _largest_distance(state.velocity[ticks], state.dt) < TRAVEL_SHARE * turned


def _merge_turns(
    state: TrueState, moves: list[TickSpan], turns: list[TickSpan], in_place: list[TickSpan]
) -> list[TickSpan]:
    """Movements and turns of a stretch, apart: what travels and turns is a movement.

    What is left of a turn before or after a movement is a turn, if it is not shorter than a rest. A small
    turn beside anything larger is nothing.
    """
    rest = round(REST_S / state.dt)
    remaining = [
        turn for turn in in_place if not any(m.first < turn.first and turn.last < m.last for m in moves)
    ]
    moves = [_without_turn_edges(move, remaining) for move in moves]
    moves = [move for move in moves if move.first < move.last]
    for turn in turns:
        if turn.small or turn in in_place:
            continue
        at = turn.first
        for index, move in enumerate(moves):
            if not _overlap(turn, move):
                continue
            begin = move.first if move.first - at >= rest else min(at, move.first)
            end = move.last if turn.last - move.last >= rest else max(turn.last, move.last)
            moves[index] = move._replace(first=begin, last=end)
            remaining += [turn._replace(first=at, last=begin)] * (begin > at)
            at = end
        remaining += [turn._replace(first=at)] * (turn.last > at)
    small = [turn for turn in turns if turn.small and not any(_overlap(turn, m) for m in moves + remaining)]
    return sorted(moves + remaining + small)


def _without_turn_edges(move: TickSpan, turns: list[TickSpan]) -> TickSpan:
    """A movement without the ends that smoothing has put into a turn beside it."""
    first = max([move.first, *(turn.last for turn in turns if turn.first <= move.first < turn.last)])
    last = min([move.last, *(turn.first for turn in turns if turn.first < move.last <= turn.last)])
    return move._replace(first=first, last=last)


def _overlap(one: TickSpan, other: TickSpan) -> bool:
    return one.first < other.last and other.first < one.last


def _ideal_moves(
    velocity: Array, speed: Array, dt: float, cls: Class, distance_of: DistanceMeasure
) -> list[TickSpan]:
    """Movements of ideal people: what exceeds 5 mm/s, if it exceeds 10 mm/s."""
    moves = []
    for a, b in runs(speed > START_M_PER_S):
        small = bool(speed[a:b].max() < SMALL_M_PER_S or distance_of(velocity[a:b], dt) < SMALL_M)
        if speed[a:b].max() > SURE_M_PER_S:
            moves.append(TickSpan(a, b, cls, small or _is_slip(a, b, dt, cls)))
    return moves


def _guided_moves(
    velocity: Array, speed: Array, dt: float, cls: Class, distance_of: DistanceMeasure
) -> list[TickSpan]:
    """Movements of people with habits: what exceeds 10 mm/s, and beside it tracing and small corrections.

    A small run beside a large one is a correction: the large movement starts and stops where it does itself.
    """
    rest = round(REST_S / dt)
    large = [
        (a, b)
        for a, b in runs(speed > SURE_M_PER_S)
        if speed[a:b].max() >= SMALL_M_PER_S and distance_of(velocity[a:b], dt) >= SMALL_M
    ]
    fast = [TickSpan(a, b, cls, _is_slip(a, b, dt, cls)) for a, b in _join_close(large, rest)]
    remaining = speed > TRACING_M_PER_S
    for move in fast:
        remaining[move.first : move.last] = False
    slow = []
    for a, b in _join_close(runs(remaining), rest, apart=fast):
        traced = distance_of(velocity[a:b], dt) >= TRACING_M
        if traced or speed[a:b].max() > SURE_M_PER_S:
            slow.append(TickSpan(a, b, cls, not traced or _is_slip(a, b, dt, cls)))
    return sorted(fast + slow)


def _join_close(
    stretches: list[tuple[int, int]], rest: int, apart: Sequence[TickSpan] = ()
) -> list[tuple[int, int]]:
    """Join stretches that less than a rest [ticks] parts, unless a span of `apart` lies between them."""
    joined: list[tuple[int, int]] = []
    for first, last in stretches:
        before = joined[-1][1] if joined else -rest
        if first - before < rest and not any(before <= span.first < first for span in apart):
            first = joined.pop()[0]
        joined.append((first, last))
    return joined


def _chord_length(velocity: Array, dt: float) -> float:
    return float(np.linalg.norm(np.sum(velocity, axis=0) * dt))


def _largest_distance(velocity: Array, dt: float) -> float:
    """Return the largest distance [m] of a movement from its start; not 0 for one that returns."""
    return float(np.linalg.norm(np.cumsum(velocity, axis=0) * dt, axis=1).max())


def _is_slip(first: int, last: int, dt: float, cls: Class) -> bool:
    return cls == "sliding" and (last - first) * dt < SLIDE_S


def _join_short_rests(moves: list[TickSpan], length: int, rest: int) -> list[TickSpan]:
    """Movements without the rests that are too short to part them: two that are alike become one.

    A small movement takes a short rest beside it, so that the large one starts and stops where it does.
    """
    joined: list[TickSpan] = []
    for move in moves:
        begin = 0 if move.first < rest else move.first
        end = length if length - move.last < rest else move.last
        if joined and begin - joined[-1].last < rest:
            before = joined.pop()
            if before.small == move.small and before.cls != move.cls:
                begin = (before.last + begin) // 2
                joined.append(before._replace(last=begin))
            elif before.small == move.small:
                begin = before.first
            elif before.small:
                joined.append(before._replace(last=begin))
            else:
                joined.append(before)
                begin = before.last
        joined.append(move._replace(first=begin, last=end))
    return [move for move in joined if move.first < move.last]


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
    return first == last or _largest_distance(state.velocity[first:last], state.dt) < SMALL_M


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
    return _smooth(np.linalg.norm(velocity, axis=1), state.dt)


def _smoothed(state: TrueState, span: TickSpan, *, guided: bool) -> Array:
    part = state.velocity_of_class(span.first, span.last, span.cls, guided=guided)
    smooth: Array = uniform_filter1d(part, round(SMOOTH_S / state.dt), axis=0)
    return smooth


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
    """Where the force of each press begins to decay for good."""
    marks = []
    for first, last in presses:
        hand_force_n = _smooth(state.hand_force_n[first:last], state.dt)
        strong = np.flatnonzero(hand_force_n > DECAY_BEGINS * _plateau(hand_force_n))
        if strong.size and (last - first - strong[-1]) * state.dt > DECAY_LEAST_S:
            marks.append(_mark(_time(state, first + int(strong[-1])), "optional", "decay"))
    return marks


def _is_pressed(state: TrueState, first: int, last: int) -> bool:
    """Whether the hand presses: a load that touches as it is put down may carry itself."""
    return _strong(_smooth(state.hand_force_n[first:last], state.dt)) > TOUCH_N


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
