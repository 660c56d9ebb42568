"""The simulated state as consecutive spans of one class: contact, then movement and rest within it.

Where the whole pose is read, an angular rate counts as the speed that it gives a point at a hand's breadth
(0.1 m). So every threshold of the rule holds for turns too: 10 mm/s are 0.1 rad/s.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from caesura_lab.teacher.motion_profiles import Array
from caesura_lab.teacher.speed_dip_truth import SMALL_M, SMALL_M_PER_S
from caesura_service.constants import GRAVITY

Class = Literal["motion", "steady", "contact", "transport", "hold", "sliding", "turning"]
Mask = NDArray[np.bool_]
DistanceMeasure = Callable[[Array, float], float]

START_M_PER_S, SURE_M_PER_S = 0.005, 0.010  # motion is above the first, and exceeds the second
REST_S = 0.3
SMOOTH_S = 0.06
SLIDE_S = 0.5  # shorter slips belong to the touching or the letting go
BOUNCE_S = 0.15  # contact lost for less is not lost
TOUCH_S, TOUCH_N = 0.05, 1.0  # contact shorter or weaker is none
TRACING_M_PER_S, TRACING_M = 0.004, 0.012  # slow motion of that length is no creep
HAND_BREADTH_M = 0.1  # at which a turn is as fast as a movement
TRAVEL_SHARE = 0.25  # of the way that a turn gives a point at that distance: who travels less turns in place


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


def runs(mask: Mask) -> list[tuple[int, int]]:
    """Return the first and last (exclusive) tick of each run in which a mask holds."""
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


def spans_of(state: TrueState, contacts: list[tuple[int, int]], *, guided: bool) -> list[TickSpan]:
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
    distance_of = largest_distance if state.turns else _chord_length
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
    return velocity, smooth(np.linalg.norm(velocity, axis=1), state.dt), state.dt


def smooth(values: Array, dt: float) -> Array:
    """Values (n,) at ticks [s], each the mean of those around it."""
    smoothed: Array = uniform_filter1d(values, round(SMOOTH_S / dt), mode="nearest")
    return smoothed


def _in_place(state: TrueState, first: int, turn: TickSpan) -> bool:
    """Whether the tip hardly travels in a turn of a stretch that begins at a tick."""
    ticks = slice(first + turn.first, first + turn.last)
    turned = state.dt * float(np.linalg.norm(HAND_BREADTH_M * state.rate[ticks], axis=1).sum())
    return largest_distance(state.velocity[ticks], state.dt) < TRAVEL_SHARE * turned


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


def largest_distance(velocity: Array, dt: float) -> float:
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
