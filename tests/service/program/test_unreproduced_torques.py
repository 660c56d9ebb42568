"""Torques that were held in a press and that no app exerts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from caesura_protocol.messages import App, ScrewMotion
from caesura_service.program import unreproduced_torques_note
from harness.programs import app, path_from

Array = NDArray[np.float64]
PLACE = (0.4, 0.0, 0.2)
PRESS = app("apply_force", 2.0, 5.0, PLACE, force=(0.0, 0.0, -12.0), force_taught=(0.0, 0.0, -12.0))


def held(newton_metres: float, seconds: float = 2.0) -> NDArray[np.float64]:
    """The torque about z in a press of 3 s, where a lever adds 3 Nm about x."""
    twists = np.where(np.arange(30) < 10.0 * seconds, newton_metres, 0.0)
    return np.column_stack([np.full(30, 3.0), np.zeros(30), twists])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_torque_that_was_held_without_a_turn_is_stated(sign: float):
    """A hand that twisted a handle with 2 Nm for 2 s taught a press, without a word."""
    assert unreproduced_torques_note((PRESS,), lambda t0, tn: held(sign * 2.0)) == (
        "Torques that no app exerts, because nothing turned: a torque of 2.0 Nm about the force at 2.0–5.0 s."
    )


@pytest.mark.parametrize("torques", [held(0.0), held(0.4), held(2.0, seconds=0.8), np.empty((0, 3))])
def test_a_lever_a_small_torque_and_a_jerk_are_not_stated(torques: NDArray[np.float64]):
    assert unreproduced_torques_note((PRESS,), lambda t0, tn: torques) is None


def test_what_has_a_way_or_touches_is_not_stated():
    path = path_from((0.3, 0.0, 0.2), 2.0, 5.0, 0.1)
    stroke = PRESS.model_copy(update={"path": path})
    moves = app("cartesian_motion", 5.0, 8.0, PLACE, path=path)
    assert unreproduced_torques_note((stroke, moves), lambda t0, tn: held(2.0)) is None
    touches = app("move_to_contact", 0.0, 1.0, PLACE, path=path)
    assert unreproduced_torques_note((touches, stroke), twisted(1.0, 2.0)) is None


def twisted(t0: float, tn: float, weights_nm: tuple[float, float] = (0.0, 0.0)) -> Callable[..., Array]:
    """A torque of 1.5 Nm about x between two times, beside those of weights about y before and after 3 s."""

    def between(begin: float, end: float) -> Array:
        t = np.arange(begin, end + 0.01, 0.1)
        before, after = weights_nm
        twists = np.where((t >= t0) & (t <= tn), 1.5, 0.0)
        return np.column_stack([twists, np.where(t < 3.0, before, after), np.zeros(t.size)])

    return between


MOVES = (app("cartesian_motion", 0.0, 2.0, PLACE), app("cartesian_motion", 5.0, 6.0, PLACE))
HOLDS = (
    app("transport", 0.0, 2.0, PLACE),
    app("hold", 2.0, 5.0, PLACE),
    app("transport", 5.0, 6.0, PLACE),
)


@pytest.mark.parametrize("apps", [MOVES, HOLDS])
@pytest.mark.parametrize("weights_nm", [(0.0, 0.0), (2.0, 2.0), (0.0, 2.0)])
@pytest.mark.parametrize(("t0", "stated"), [(2.5, True), (3.8, False), (9.0, False)])
def test_a_torque_in_a_rest_or_a_hold_is_stated_beside_those_of_weights(
    apps: tuple[App, ...], weights_nm: tuple[float, float], t0: float, stated: bool
):
    """A hand twisted the tool with 1.5 Nm in the air, or what it held, and nothing turned."""
    found = unreproduced_torques_note(apps, twisted(t0, 4.5, weights_nm), 0.0, 6.0)
    said = "Torques that no app exerts, because nothing turned: a torque of 1.5 Nm at 2.0–5.0 s."
    assert found == (said if stated else None)


@pytest.mark.parametrize(("turned_nm", "stated"), [(0.9, True), (1.1, False)])
def test_a_torque_that_was_held_after_a_turn_is_stated_if_no_turn_reaches_it(turned_nm: float, stated: bool):
    """A screw was turned with 1 Nm and then held with 2.5 Nm: a robot ends its turn at 1.5 Nm."""
    path = path_from(PLACE, 2.0, 3.0, 0.001)
    up = (0.0, 0.0, 1.0)
    screw = ScrewMotion(axis=up, point=PLACE, angle=1.0, pitch_m=0.0, pitch_sd_m=0.0)
    screw = screw.model_copy(update={"torque": (0.0, 0.0, turned_nm)})
    turn = PRESS.model_copy(update={"path": path, "screw": screw, "tn": 6.0})

    def along_the_force(begin: float, end: float) -> Array:
        return twisted(3.5, 5.5)(begin, end)[:, [1, 2, 0]]

    found = unreproduced_torques_note((turn,), along_the_force)
    said = "a torque of 1.5 Nm about the force at 3.0–6.0 s"
    assert found == (f"Torques that no app exerts, because nothing turned: {said}." if stated else None)
