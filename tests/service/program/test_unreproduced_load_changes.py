"""Changes of a load that is carried as one are named, unless noise and drift of the sensor explain them."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from caesura_service.constants import GRAVITY
from caesura_service.program import GripperAction, Moment, unreproduced_load_changes_note
from service.program.segments import ACROSS, UPRIGHT, program, segment

STILL = {"position_start": (0.1, 0.0, 0.2), "position_end": (0.1, 0.0, 0.2)}
LOAD = {"load_kg": 0.6, "load_sd_kg": 0.02}


def note(load_kg: Callable[[float], float], *, noise_n: float = 0.1, turns: bool = False) -> str | None:
    """A carry from 0 to 2 s, a hold until 5 s, and a carry until 7 s; the note on the changes of its load."""
    rng = np.random.default_rng(3)

    @cache
    def at(t: float) -> Moment:
        x = 0.05 * min(t, 2.0) + 0.05 * max(t - 5.0, 0.0)
        angle = 0.3 * t if turns else 0.0
        turned = (float(np.cos(angle / 2.0)), float(np.sin(angle / 2.0)), 0.0, 0.0)
        force = (0.0, 0.0, -GRAVITY * load_kg(t) + float(rng.normal(scale=noise_n)))
        return Moment((x, 0.0, 0.2), turned if turns else UPRIGHT, None, None, force)

    apps = program(
        segment("transport", 0.0, 2.0, **LOAD, **ACROSS),
        segment("hold", 2.0, 5.0, **LOAD, **STILL),
        segment("transport", 5.0, 7.0, **LOAD, **ACROSS),
        grips=(GripperAction(-1.0, "grasp", 0.03),),
        at=at,
    )
    return unreproduced_load_changes_note(apps, at)


@pytest.mark.parametrize("change_kg", [0.1, 0.24, -0.15])
def test_a_load_that_changes_in_a_hold_and_is_carried_as_one_is_named(change_kg: float) -> None:
    """A cup of 0.5 kg that got 0.2 kg more was carried as 0.6 kg, without a finding."""
    found = note(lambda t: 0.5 if t < 3.5 else 0.5 + change_kg)
    assert found is not None
    ((kg, t),) = re.findall(r"by (-?\d\.\d\d) kg at (\d\.\d) s", found)
    assert float(kg) == pytest.approx(change_kg, abs=0.02)
    assert float(t) == pytest.approx(3.5, abs=0.25)


@pytest.mark.parametrize(
    ("load_kg", "noise_n"),
    [
        (lambda t: 0.5, 0.1),
        (lambda t: 0.5, 1.0),
        (lambda t: 0.5 if t < 3.5 else 0.6, 1.0),  # hidden by noise
        (lambda t: 0.5 if t < 3.5 else 0.525, 0.02),  # a sensor drifts by as much
        (lambda t: 0.5 + 0.1 * min(max(t - 2.0, 0.0), 3.0) / 3.0, 0.1),
        (lambda t: 0.5 if t < 2.0 or t > 5.0 else 0.7, 0.1),  # while it moves the bias may change, too
    ],
)
def test_noise_and_drift_of_a_sensor_are_no_change_of_a_load(
    load_kg: Callable[[float], float], noise_n: float
) -> None:
    assert note(load_kg, noise_n=noise_n) is None


def test_a_bias_may_change_while_the_flange_turns() -> None:
    assert note(lambda t: 0.5 if t < 3.5 else 0.7, turns=True) is None
