"""Torques that were held in a press and that no app exerts."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from caesura_service.program import missed_torques_note
from harness.programs import app, path_from

PLACE = (0.4, 0.0, 0.2)
PRESS = app("apply_force", 2.0, 5.0, PLACE, force=(0.0, 0.0, -12.0), force_taught=(0.0, 0.0, -12.0))


def held(newton_metres: float, seconds: float = 2.0) -> NDArray[np.float64]:
    """The torque about z in a press of 3 s, where a lever adds 3 Nm about x."""
    twists = np.where(np.arange(30) < 10.0 * seconds, newton_metres, 0.0)
    return np.column_stack([np.full(30, 3.0), np.zeros(30), twists])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_torque_that_was_held_without_a_turn_is_stated(sign: float):
    """A hand that twisted a handle with 2 Nm for 2 s taught a press, without a word."""
    assert missed_torques_note((PRESS,), lambda t0, tn: held(sign * 2.0)) == (
        "Taught and exerted by no app, because nothing turned: "
        "a torque of 2.0 Nm about the force at 2.0–5.0 s."
    )


@pytest.mark.parametrize("torques", [held(0.0), held(0.4), held(2.0, seconds=0.8), np.empty((0, 3))])
def test_a_lever_a_small_torque_and_a_jerk_are_not_stated(torques: NDArray[np.float64]):
    assert missed_torques_note((PRESS,), lambda t0, tn: torques) is None


def test_what_has_a_way_or_presses_nothing_is_not_stated():
    path = path_from((0.3, 0.0, 0.2), 2.0, 5.0, 0.1)
    stroke = PRESS.model_copy(update={"path": path})
    assert missed_torques_note((stroke, app("hold", 5.0, 8.0, PLACE)), lambda t0, tn: held(2.0)) is None
