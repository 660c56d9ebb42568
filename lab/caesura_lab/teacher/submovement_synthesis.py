"""Movements as people make them: a curved path, covered by submovements that overlap.

The path is a spline through places, bowed aside. The progress along it is a sum of submovements, each with
the person's speed profile (Flash & Henis 1991; Krebs et al. 1999).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicSpline

from caesura_lab.teacher.habits import Habits
from caesura_lab.teacher.motion_profiles import UNIT_RESPONSES, Array, Profile

OVERLAPS = (0.3, 0.8)
LEAST_S = 0.25  # a submovement lasts at least this long
LONGEST_BOW_M = 0.08
SLOW_OVERLAP = 0.7
PAUSE_S = (0.05, 0.28)
HOMING_S, HOMING_SHARE = (0.35, 1.1), (0.02, 0.12)
EASING_S, EASING_SHARE = (0.25, 0.8), (0.02, 0.1)
BOW_SPREAD, WEIGHT_SPREAD, TIME_SPREAD = 0.6, 0.25, 0.2
LONGEST_EDGE = 0.4  # of the movement's duration, which a slow first or last submovement takes


@dataclass(frozen=True)
class Submovement:
    """One share of the way. Start and duration are shares of the movement's duration."""

    start: float
    duration: float
    weight: float


@dataclass(frozen=True)
class Sweep:
    """One intended movement along a curve.

    places: (k, 3) [m], displacements that the curve passes, first zero; bow: (2, 3) [m], amplitudes of a half
    wave and a full wave aside; deviation: as of a `Stroke`.
    """

    start_s: float
    duration_s: float
    places: Array
    submovements: tuple[Submovement, ...]
    profile: Profile = "minimum_jerk"
    bow: Array = field(default_factory=lambda: np.zeros((2, 3)))
    deviation: Array = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def end_s(self) -> float:
        """Time at which it has arrived [s]."""
        return self.start_s + self.duration_s

    def progress(self, tau: Array) -> Array:
        """Share of the way (n,) covered at shares of the duration (n,)."""
        done = np.zeros_like(tau)
        for sub in self.submovements:
            done += sub.weight * UNIT_RESPONSES[self.profile](
                np.clip((tau - sub.start) / sub.duration, 0.0, 1.0)
            )
        return done

    def positions(self, t: Array) -> Array:
        """Displacement at times t (n,) [s], (n, 3) [m]."""
        tau = np.clip((t - self.start_s) / self.duration_s, 0.0, 1.0)
        share = self.progress(tau)
        moved = curve(self.places, share)
        for k, amplitude in enumerate(self.bow, start=1):
            moved += np.sin(k * np.pi * share)[:, None] * amplitude
        for k, amplitude in enumerate(self.deviation, start=1):
            moved += (np.sin(np.pi * tau) ** 2 * np.sin(k * np.pi * tau))[:, None] * amplitude
        return moved


def curve(places: Array, share: Array) -> Array:
    """Points (n, 3) [m] of a smooth curve through places (k, 3), at shares (n,) of its length."""
    if len(places) == 2:
        return np.outer(share, places[1])
    chords = np.linalg.norm(np.diff(places, axis=0), axis=1)
    knots = np.concatenate([[0.0], np.cumsum(chords)]) / chords.sum()
    smooth: Array = CubicSpline(knots, places, bc_type="natural")(share)
    return smooth


def draw_submovements(
    duration_s: float, habits: Habits, rng: np.random.Generator, *, slow: bool = False
) -> tuple[Submovement, ...]:
    """Draw the submovements of a movement: a train, and slow ones at its ends by chance.

    duration_s: of the movement; slow: it is so slow that its submovements blend into an even speed.
    """
    easing = _draw_edge(habits.easing, EASING_S, EASING_SHARE, duration_s, rng)
    homing = _draw_edge(habits.homing, HOMING_S, HOMING_SHARE, duration_s, rng)
    begin, end = easing.duration / 2.0, 1.0 - homing.duration / 2.0
    weight = 1.0 - easing.weight - homing.weight
    train = [
        Submovement(begin + (end - begin) * s.start, (end - begin) * s.duration, weight * s.weight)
        for s in _draw_train((end - begin) * duration_s, habits, rng, slow=slow)
    ]
    ends = (easing, Submovement(1.0 - homing.duration, homing.duration, homing.weight))
    return (*train, *(s for s in ends if s.weight))


def draw_bow(places: Array, habits: Habits, rng: np.random.Generator, *, flat: bool) -> Array:
    """Draw by how much a path leaves its places, (2, 3) [m], across its chord; flat: within a level plane."""
    way = places[-1]
    length = float(np.linalg.norm(way))
    across = rng.normal(size=(2, 3)) * (1.0, 1.0, 0.0 if flat else 0.7)
    across -= np.outer(across @ way, way) / max(length**2, 1e-12)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    sizes = length * np.array([habits.bow * np.exp(BOW_SPREAD * rng.normal()), habits.sway * rng.normal()])
    return np.asarray(np.clip(sizes, -LONGEST_BOW_M, LONGEST_BOW_M)[:, None] * across)


def _draw_edge(
    chance: float,
    seconds: tuple[float, float],
    shares: tuple[float, float],
    duration_s: float,
    rng: np.random.Generator,
) -> Submovement:
    """Draw a slow submovement at the end of a movement; of no duration and weight where chance has none."""
    chosen, length, weight = rng.random() < chance, rng.uniform(*seconds), rng.uniform(*shares)
    return (
        Submovement(0.0, min(LONGEST_EDGE, length / duration_s), weight)
        if chosen
        else Submovement(0.0, 0.0, 0.0)
    )


def _draw_train(
    duration_s: float, habits: Habits, rng: np.random.Generator, *, slow: bool
) -> Sequence[Submovement]:
    """Draw overlapping submovements that fill a duration [s]; two of them may have a short pause between."""
    interval = habits.submovement_s * np.exp(TIME_SPREAD * rng.normal())
    count = max(1, min(round(duration_s / interval), int(duration_s / LEAST_S)))
    lengths = np.exp(TIME_SPREAD * rng.normal(size=count))
    meant = SLOW_OVERLAP if slow else habits.overlap
    overlap = np.clip(meant + 0.1 * rng.normal(size=count - 1), *OVERLAPS)
    gaps = -overlap * np.minimum(lengths[:-1], lengths[1:])
    if count > 1 and rng.random() < habits.pause:
        gaps[rng.integers(count - 1)] = rng.uniform(*PAUSE_S) * count / duration_s
    starts = np.concatenate([[0.0], np.cumsum(lengths[:-1] + gaps)])
    whole = float((starts + lengths).max())
    weights = lengths * np.exp(WEIGHT_SPREAD * rng.normal(size=count))
    parts = zip(starts / whole, lengths / whole, weights / weights.sum(), strict=True)
    return [Submovement(float(s), float(d), float(w)) for s, d, w in parts]
