"""The habits of a person beyond ideal movements: bows, submovements, hesitations, creep, brief presses.

`IDEAL` has none of them: point-to-point strokes, as the thesis has them. `draw_habits` draws the habits of
one person. Its ranges come from hand-guided recordings: docs/realism.md has the figures and the command.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np


@dataclass(frozen=True)
class Habits:
    """The habits in which the movements of one person differ from ideal strokes.

    Shares are of a movement's length, probabilities are per movement or pause.
    """

    bow: float = 0.0  # median distance of a path from its chord
    sway: float = 0.0  # by which a path crosses its chord, standard deviation
    submovement_s: float = (
        inf  # mean interval between the starts of submovements; one a movement where infinite
    )
    overlap: float = 0.5  # share of its duration by which a submovement reaches into the next
    rounding: float = 0.0  # by which a movement reaches into the next where it passes, more than ideal ones
    pause: float = 0.0  # probability of a pause under 0.3 s within a movement
    homing: float = 0.0  # probability of a slow last submovement
    easing: float = 0.0  # probability of a slow first submovement
    drift: float = 0.0  # probability of creep after a stop, and before the next start
    tempo: float = 0.0  # relative change of the intended speed, standard deviation
    smoothing_s: float = 0.03  # over which the hand smooths what it means to do
    brief_press: float = 0.0  # probability of a press of 0.25 to 0.5 s
    speed_noise: bool = False  # noise of hand and sensor grows with speed beyond 0.1 m/s


IDEAL = Habits()


def draw_habits(rng: np.random.Generator) -> Habits:
    """Draw the habits of one person from a generator."""
    return Habits(
        bow=rng.uniform(0.05, 0.16),
        sway=rng.uniform(0.02, 0.06),
        submovement_s=rng.uniform(0.5, 1.1),
        overlap=rng.uniform(0.58, 0.72),
        rounding=rng.uniform(0.0, 0.2),
        pause=rng.uniform(0.05, 0.2),
        homing=rng.uniform(0.2, 0.6),
        easing=rng.uniform(0.3, 0.7),
        drift=rng.uniform(0.1, 0.4),
        tempo=rng.uniform(0.04, 0.12),
        smoothing_s=rng.uniform(0.04, 0.08),
        brief_press=rng.uniform(0.1, 0.4),
        speed_noise=True,
    )
