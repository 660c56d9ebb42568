"""Compares how two programs divide the same movement into apps, and whether the motion differs there.

A corner may be a boundary in one of two recordings of the same movement. So apps in the air that follow each
other count as one movement, and so do those of a carry with one load. A division that only one program states
is no difference if the motion is the same there: no long rest, and both recordings slow down alike.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise, zip_longest
from typing import NamedTuple

import numpy as np

from caesura_protocol.messages import App, Vector
from caesura_protocol.programs.app_time_shifts import TURNED_M
from caesura_protocol.recording import Recording
from caesura_protocol.rotations import turned_along
from caesura_service.program.forces.stroke_forces import STROKE_REST_S
from caesura_service.program.interpretation.joined_movements import NEAR_S
from caesura_service.program.program_segment import OBSERVED_S

AROUND_S = 0.3  # a movement may slow down a little earlier or later in its run
SLOWED_SHARE = 0.15  # of the hand's speed beside a division, by which hand and robot may differ there
RESTS_M_PER_S = 1e-3  # of a hand at rest
NO_PLACE = (math.nan, math.nan, math.nan)


class Division(NamedTuple):
    """The end of a part of a movement: its time [s] and place [m], and how long the movement rests [s] there.

    held: whether the rest is a hold of a carry.
    """

    t: float
    place: Vector
    rest_s: float
    held: bool


class Difference(NamedTuple):
    """A division that only one of two programs states; is_taught: whether it is the taught one."""

    division: Division
    is_taught: bool


class WholeMovement(NamedTuple):
    """Successive apps that form one movement, the index of the first; one app where they form none."""

    first: int
    apps: tuple[App, ...]

    @property
    def kind(self) -> str:
        """The kind of its last app; a carry is a transport."""
        kinds = [app.kind for app in self.apps]
        return "transport" if "transport" in kinds else kinds[-1]

    @property
    def last(self) -> tuple[int, App]:
        """Return its last app, with its index in the program."""
        return self.first + len(self.apps) - 1, self.apps[-1]

    @property
    def divisions(self) -> Iterator[Division]:
        """The divisions of the movement, in time order."""
        for app, following in zip_longest(self.apps, self.apps[1:]):
            place = app.target or NO_PLACE
            if app.kind == "hold":
                yield Division(0.5 * (app.t0 + app.tn), place, app.tn - app.t0, held=True)
            elif following is not None and following.kind != "hold":
                t, rest_s = 0.5 * (app.tn + following.t0), following.t0 - app.tn
                yield Division(t, place, rest_s, held=False)


def movements_of(apps: Sequence[App]) -> list[WholeMovement]:
    """Return the movements of a program, in time order; every other app is one of its own."""
    starts = [0, *(k for k, pair in enumerate(pairwise(apps), start=1) if not _goes_on(*pair))]
    return [WholeMovement(a, tuple(apps[a:b])) for a, b in pairwise([*starts, len(apps)]) if b > a]


def _goes_on(app: App, following: App) -> bool:
    """Return whether two apps move in the air, or carry the same load."""
    carry = ("transport", "hold")
    if app.kind in carry and following.kind in carry:
        return app.load_kg == following.load_kg
    return app.kind == "cartesian_motion" and following.kind in ("cartesian_motion", "move_to_contact")


def differences(taught: WholeMovement, executed: WholeMovement, most_m: float) -> list[Difference]:
    """Return the divisions that only one of two movements states, in pairs that keep their order in time.

    Two are the same if they lie within `most_m` of each other, and both or neither are holds. A movement may
    return to a place: as few as possible are left without a pair, and of these the ones with the least rest.
    """
    mine, others = list(taught.divisions), list(executed.divisions)

    @cache
    def left(i: int, j: int) -> tuple[Difference, ...]:
        """Return what is left of the divisions from the i-th taught and the j-th executed one on."""
        if i == len(mine) or j == len(others):
            rest = [Difference(one, is_taught=True) for one in mine[i:]]
            return (*rest, *(Difference(other, is_taught=False) for other in others[j:]))
        choices = [
            (Difference(mine[i], is_taught=True), *left(i + 1, j)),
            (Difference(others[j], is_taught=False), *left(i, j + 1)),
        ]
        if _are_same(mine[i], others[j], most_m):
            choices.insert(0, left(i + 1, j + 1))
        return min(choices, key=lambda only: (len(only), sum(one.division.rest_s for one in only)))

    return sorted(left(0, 0), key=lambda only: not only.is_taught)


def _are_same(one: Division, other: Division, most_m: float) -> bool:
    return one.held == other.held and math.dist(one.place, other.place) <= most_m


@dataclass(frozen=True)
class BothMotions:
    """The recordings of a demonstration and of its run.

    taught_s, run_s: begin and end [s] of each app in them; retimed: whether the run has other speeds than
    the demonstration, because the program demands them.
    """

    taught: Recording
    run: Recording
    taught_s: Sequence[tuple[float, float]]
    run_s: Sequence[tuple[float, float]]
    retimed: bool = False

    def difference_at(self, only: Difference) -> str | None:
        """Return how the motion differs at a division that only one program states, or None."""
        t, rest_s, is_taught = only.division.t, only.division.rest_s, only.is_taught
        if rest_s >= STROKE_REST_S:
            return f"a rest of {rest_s:.1f} s"
        if self.retimed:
            return None
        taught_s, run_s = np.ravel(self.taught_s), np.ravel(self.run_s)
        hand, beside = speeds_at(self.taught, t if is_taught else float(np.interp(t, run_s, taught_s)))
        robot, _ = speeds_at(self.run, float(np.interp(t, taught_s, run_s)) if is_taught else t)
        if abs(hand - robot) <= max(SLOWED_SHARE * beside, RESTS_M_PER_S):
            return None
        return f"the hand slows down to {1000 * hand:.0f} mm/s there, the robot to {1000 * robot:.0f} mm/s"


def speeds_at(recording: Recording, t: float) -> tuple[float, float]:
    """Return the least speed [m/s] within `AROUND_S` of a time [s], and the lesser peak on both sides.

    The peaks lie within `NEAR_S`. A turn counts as a way of `TURNED_M` a radian.
    """
    times = t + OBSERVED_S * np.arange(-round(NEAR_S / OBSERVED_S), round(NEAR_S / OBSERVED_S) + 1)
    rows = np.clip(np.searchsorted(recording.t, times), 0, len(recording.t) - 1)
    position, turned = recording.signals["pos"][rows], turned_along(recording.signals["quat"][rows])
    ways = sum(np.linalg.norm(np.diff(way, axis=0), axis=1) for way in (position, TURNED_M * turned))
    middle, near = len(ways) // 2, round(AROUND_S / OBSERVED_S)
    peak = min(ways[:middle].max(), ways[middle:].max())
    return float(ways[middle - near : middle + near].min()) / OBSERVED_S, float(peak) / OBSERVED_S
