"""The thesis' four demonstrations: the teacher's scenarios timed by the thesis' tables, and who teaches them.

A person of this suite keeps the thesis' times, forces and load to the letter, as `THESIS` does: speed, pauses
and forces times one, no irregularity, hesitation or correction, 250 g. The body and the sensors (`DRAWN`) are
drawn from the seed as `draw_person` draws them, and so is the chance of one demonstration. A sensor's bias
wanders by 0.3 N, as `THESIS` has it: the thesis' tables read less than 0.2 N in free space from the first
second to the last, and `draw_person` draws 0.9 N at the median. With `wander` it wanders as drawn.

The scenarios differ from the teacher's own where these were timed for a hand that starts softly, or leave out
what a table shows:

- the first movement begins with the recording: in the tables the first segment is a movement from 0.0 s;
- where a press is let go, the force falls through what the tables of the force and contact models give, at
  the times they give (Fig. 4.13 to 4.15), and only then does the hand move away;
- the dispenser's spring carries the press: a force that takes 0.5 s to fall does not come from a hard stop.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from caesura_clients.bridge.teacher.intentions import Profile
from caesura_clients.bridge.teacher.person import THESIS, Person, draw_person
from caesura_clients.bridge.teacher.scenarios import (
    DISPENSER,
    PARKOUR,
    PICK_AND_PLACE,
    PUMP,
    SCENARIOS,
    THREE_POINT,
    Scenario,
    Step,
)
from caesura_clients.recording import Recording
from caesura_service.judge.truth import Truth, truth_of

BODY = (
    "stiffness_n_per_m",
    "damping_ns_per_m",
    "tremor_n",
    "wander_n",
    "unrest_n",
    "deviation",
    "scatter",
    "preload_n",
    "impact_m",
)
SENSORS = ("position_noise_m", "force_noise_n", "motion_noise_n", "bias_n")
DRAWN = (*BODY, *SENSORS)
PRESS_N = 20.0  # "approx 20 Newton", with which the dispenser is pushed to its stop


def _timed(scenario: Scenario, changes: Mapping[float, tuple[Step, ...]], first: int = 1) -> Scenario:
    """The scenario from its step `first` on; a step that ends at a time of `changes` gives way to those."""
    steps = (changes.get(step.until_s, (step,)) for step in scenario.steps[first:])
    return replace(scenario, steps=tuple(step for some in steps for step in some))


def _press(until_s: float, force_n: float) -> Step:
    return Step("press", until_s, force_n=force_n)


_PUMP = replace(PUMP, spring_n_per_m=(PRESS_N - PUMP.preload_n) / PUMP.travel_m)

TIMED: Mapping[str, Scenario] = MappingProxyType(
    {
        "three_point": _timed(THREE_POINT, {}),
        "parkour": _timed(PARKOUR, {}, first=0),
        "pick_and_place": _timed(
            PICK_AND_PLACE,
            {3.8: (_press(4.1, 3.3), _press(4.2, 1.1)), 10.1: (_press(10.1, 3.0), _press(10.2, 2.5))},
        ),
        "dispenser": replace(
            _timed(
                DISPENSER,
                {4.2: (_press(4.2, 21.0), _press(4.7, 2.4)), 9.3: (_press(9.3, 20.0), _press(9.7, 4.1))},
            ),
            surfaces=(_PUMP,),
        ),
    }
)


@dataclass(frozen=True)
class Taught:
    """One demonstration of the suite, not simulated yet. It can be pickled.

    wander: the sensor's bias wanders as drawn; timed: by the thesis' tables, not as the teacher has it.
    """

    scenario: str
    seed: int
    profile: Profile
    wander: bool = False
    timed: bool = True

    def load(self) -> tuple[Recording, Truth]:
        """Simulate it."""
        # Pinocchio takes a second to load: only for who teaches.
        from caesura_clients.bridge.teacher.teaching import teach  # noqa: PLC0415

        scenario = (TIMED if self.timed else SCENARIOS)[self.scenario]
        taught = teach(scenario, seed=self.seed, person=person(self.seed, self.profile, wander=self.wander))
        return taught.recording, truth_of(taught.truth, self.scenario)


def person(seed: int, profile: Profile, *, wander: bool = False) -> Person:
    """The thesis' times and forces with a body and sensors drawn from the seed."""
    drawn = draw_person(np.random.default_rng(seed), f"person-{seed}")
    own = (*DRAWN, "bias_wander_n") if wander else DRAWN
    return replace(THESIS, name=drawn.name, profile=profile, **{name: getattr(drawn, name) for name in own})
