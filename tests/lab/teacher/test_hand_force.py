"""A hand that controls its force where it touches."""

from __future__ import annotations

from dataclasses import replace
from math import exp

import numpy as np
import pytest

from caesura_lab.teacher.hand_force import (
    SWITCH_S,
    ForceSetpoint,
    HandForceController,
    force_goal,
    force_profile,
)
from caesura_lab.teacher.hand_motion_plan import make_plan
from caesura_lab.teacher.person import THESIS, Person
from caesura_lab.teacher.scenarios import DISPENSER, PICK_AND_PLACE, Step
from lab.teacher.nominal import nominal_once

RATE_PER_S = 3.6
DT = 0.001
PERSON = replace(THESIS, profile="overdamped", force_rate_per_s=RATE_PER_S, joint_friction=0.0, preload_n=0.0)
PRESS = replace(PICK_AND_PLACE, steps=PICK_AND_PLACE.steps[:4])  # touch and press until 3.5 s
AIMS = (
    ForceSetpoint(0.5, 10.0, yields=True, waits=True),
    ForceSetpoint(1.0, 10.0, (0.1, 0.0), yields=True),
    ForceSetpoint(3.0),
)
TICKS = np.arange(4000) * DT


def followed(touch_s: float) -> tuple[list[float], list[float]]:
    """Force and control of the place at every tick, with a surface that is met at a time."""
    effort = HandForceController(force_profile(AIMS, TICKS), RATE_PER_S, DT)
    forces, places = [], []
    for tick, t in enumerate(TICKS):
        effort.update(tick, float(touch_s <= t < 3.2))
        forces.append(effort.force_n)
        places.append(effort.position_share)
    return forces, places


def test_an_aim_holds_until_the_next():
    aims = force_profile(AIMS, np.array([0.4, 0.5, 0.9, 1.0, 3.5]))
    assert aims.force.tolist() == [0.0, 10.0, 10.0, 10.0, 0.0]
    assert aims.waits.tolist() == [False, True, True, False, False]
    assert aims.aside[:, 0].tolist() == [0.0, 0.0, 0.0, 0.1, 0.0]


def test_a_force_of_a_table_is_reached_in_time_and_never_by_pulling():
    goal = force_goal(3.3, 15.0, 0.6, RATE_PER_S)
    assert goal + (15.0 - goal) * exp(-RATE_PER_S * 0.6) == pytest.approx(3.3)
    assert force_goal(1.0, 15.0, 0.1, RATE_PER_S) == 0.0


@pytest.mark.parametrize(("touch_s", "begins_s"), [(0.7, 0.7), (2.0, 1.0)])
def test_the_force_is_one_first_order_response_from_the_touch_at_the_latest_when_it_is_due(
    touch_s: float, begins_s: float
):
    forces = np.array(followed(touch_s)[0])
    since = TICKS - begins_s
    risen = (since > 0.0) & (TICKS < 3.0)
    assert forces[since < 0.0].max() == 0.0
    assert forces[risen] == pytest.approx(10.0 * (1.0 - np.exp(-RATE_PER_S * since[risen])), abs=0.05)


def test_the_place_is_given_up_where_it_touches_and_held_again_when_it_leaves():
    places = np.array(followed(0.7)[1])
    assert places[TICKS < 0.7].min() == 1.0
    assert places[(TICKS > 0.7 + 5 * SWITCH_S) & (TICKS < 3.0)].max() < 0.01
    assert places[-1] == pytest.approx(1.0)


def test_a_press_on_what_yields_is_no_movement_for_a_hand_that_controls_its_force():
    letting_go = replace(DISPENSER, steps=(*DISPENSER.steps[:3], Step("press", 4.7, force_n=2.4)))

    def fastest(person: Person) -> float:
        plan = make_plan(letting_go, person, np.random.default_rng(1))
        return float(np.abs(plan.velocity[4250:]).max())  # [m/s]

    assert fastest(PERSON) == pytest.approx(0.0, abs=1e-9)
    assert fastest(replace(PERSON, force_rate_per_s=None)) > 0.05


def test_a_hand_that_aims_little_below_a_surface_lands_in_time():
    # Once an overdamped one crept down and landed a second late.
    loose = replace(PERSON, impact_m=0.004, stiffness_n_per_m=450.0)
    (contact,) = nominal_once(PRESS, seed=3, person=loose).truth["forces"]
    assert contact["t0"] == pytest.approx(1.8, abs=0.3)


def test_what_is_taught_is_what_the_scenario_says():
    forces = nominal_once("pick_and_place", seed=1, person=PERSON).truth["forces"]
    assert [force["newton"] for force in forces] == pytest.approx([15.0, 10.0], rel=0.1)


def test_little_of_a_press_goes_sideways_and_none_is_locked_in_at_the_touch():
    # Joint friction and the lag of the hand's spring once made it a fifth; in the thesis it is 8 to 11 %.
    shares = []
    for seed in range(2, 6):
        force = nominal_once(PRESS, seed=seed, person=PERSON).recording.signals["force"][-200:]
        shares.append(np.linalg.norm(force.mean(axis=0)[:2]) / force[:, 2].mean())
    assert np.median(shares) < 0.13
