"""The inertia of a held load: the segment models get the load's weight, in movement and at rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from caesura_service.changepoint.preset import STEP_S
from caesura_service.constants import GRAVITY, LOAD_KG
from caesura_service.segmentation.load_inertia import RESTING, Acceleration, without_load_inertia
from caesura_service.segmentation.observation_store import ObservationStore
from caesura_service.signals import Observation
from service.sessions.observing import observation

Array = NDArray[np.float64]

LOAD = 2.0  # [kg]
WEIGHT = np.array([0.0, 0.0, -LOAD * GRAVITY])
CARRY_S, WAY = 1.2, np.array([0.3, 0.1, 0.05])  # of a movement with minimum jerk [m]
LEANING = np.array([[0.8, 0.0, -0.6], [0.0, 1.0, 0.0], [0.6, 0.0, 0.8]])  # maps up in the base frame to +z


def carried(*, holds: bool = True, turn: Array | None = None) -> list[Observation]:
    """Observations of a carry from rest to rest; turn: of the base, by which up is no longer +z."""
    turned = np.eye(3) if turn is None else turn
    found = []
    for i in range(25):
        u = np.clip((STEP_S * i - 0.5) / CARRY_S, 0.0, 1.0)
        velocity = (30 * u**2 - 60 * u**3 + 30 * u**4) * WAY / CARRY_S
        acceleration = (60 * u - 180 * u**2 + 120 * u**3) * WAY / CARRY_S**2
        force = WEIGHT - LOAD * acceleration
        seen = replace(observation(i, 0.0), velocity_base=turned.T @ velocity, force_base=turned.T @ force)
        found.append(replace(seen, gripper_width=0.03, gripper_closed=holds))
    return found


def forces_of(observations: list[Observation], upright: Array | None = None) -> Array:
    """Return the forces (n, 3) [N] that the segment models get."""
    history = ObservationStore(upright)
    for seen in observations:
        history.append(seen)
    return np.array([history.observed(seen.index).force for seen in observations])


@pytest.mark.parametrize("upright", [None, LEANING])
def test_a_load_weighs_the_same_in_movement_and_at_rest(upright: Array | None) -> None:
    given = np.array([seen.force_base for seen in carried()])
    assert np.abs(given - WEIGHT).max() > 2.0
    assert np.abs(forces_of(carried(turn=upright), upright) - WEIGHT).max() < 0.6


def test_the_force_of_open_fingers_is_as_measured() -> None:
    free = carried(holds=False)
    assert np.array_equal(forces_of(free), [seen.force_base for seen in free])


def test_the_acceleration_is_exact_where_it_changes_steadily() -> None:
    acceleration, t = Acceleration(), STEP_S * np.arange(6)
    velocities = np.outer(0.3 * t + 0.8 * t**2, [1.0, -1.0, 0.5])
    found = [acceleration.next(velocity, after_gap=False) for velocity in velocities]
    assert np.array_equal(found[0], RESTING)
    assert np.allclose(found[2:], np.outer(0.3 + 1.6 * t[2:], [1.0, -1.0, 0.5]))


def test_a_velocity_before_a_gap_gives_no_acceleration() -> None:
    acceleration = Acceleration()
    acceleration.next(np.ones(3), after_gap=False)
    assert np.array_equal(acceleration.next(np.zeros(3), after_gap=True), RESTING)


@pytest.mark.parametrize(("up_n", "kg"), [(8.0, 0.0), (-9.0 * LOAD_KG * GRAVITY, LOAD_KG)])
def test_a_push_has_no_mass_and_no_load_more_than_the_heaviest(up_n: float, kg: float) -> None:
    acceleration = np.array([1.0, 0.0, 0.0])
    force = np.array([0.0, 0.0, up_n])
    assert np.allclose(without_load_inertia(force, acceleration), force + kg * acceleration)


def test_a_flange_that_falls_freely_holds_no_mass() -> None:
    falls = np.array([0.5, 0.0, -1.2 * GRAVITY])
    assert np.isfinite(without_load_inertia(np.array([0.0, 0.0, -5.0]), falls)).all()
    assert np.array_equal(without_load_inertia(np.zeros(3), falls), np.zeros(3))
