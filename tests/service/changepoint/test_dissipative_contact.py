"""The force of a contact on a moving robot, by its direction."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from caesura_service.changepoint.channel_model import ModelInput
from caesura_service.changepoint.dissipative_contact import DissipativeContactWeight

LEAST_N, PACE_M = 3.0, 0.0005
CONTACT = DissipativeContactWeight(LEAST_N, PACE_M)
STEP = np.array([0.01, 0.0, 0.0])  # [m] along x, on a surface whose normal is z
PRESS_N = 12.0

force = st.lists(st.floats(-40.0, 40.0), min_size=3, max_size=3).map(np.array)
step = st.lists(st.floats(-0.03, 0.03), min_size=3, max_size=3).map(np.array)


def weight(normal_n: float, along_n: float, step_m: np.ndarray = STEP) -> float:
    return CONTACT.log_weight(np.array([along_n, 0.0, normal_n]), step_m)


@pytest.mark.parametrize(
    ("what", "normal_n", "along_n"),
    [
        ("a smooth surface", PRESS_N, 0.0),
        ("a rough surface", PRESS_N, -0.9 * PRESS_N),
        ("the box that it pushes", 0.0, -PRESS_N),
    ],
)
def test_what_resists_a_movement_takes_nothing_away(what: str, normal_n: float, along_n: float) -> None:
    """A box that was pushed with 14 N was said to be free motion, with probability 1.00."""
    assert weight(normal_n, along_n) == pytest.approx(0.0, abs=1e-3), what


@pytest.mark.parametrize(
    ("what", "normal_n", "along_n"),
    [
        ("a spring drives the hand out", 0.0, PRESS_N),
        ("something drives it along a surface", PRESS_N, PRESS_N),
        ("nothing is touched", 0.0, 0.0),
    ],
)
def test_what_drives_a_movement_is_no_contact(what: str, normal_n: float, along_n: float) -> None:
    assert weight(normal_n, along_n) < -3.0, what


def test_a_hand_that_stands_shows_no_direction() -> None:
    still = np.array([0.01 * PACE_M, 0.0, 0.0])
    assert weight(PRESS_N, PRESS_N, still) == pytest.approx(0.0, abs=0.01)


@given(force=force, step=step, turn=st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3))
def test_it_is_a_weight_of_at_most_1_that_turns_with_the_base_frame(
    force: np.ndarray, step: np.ndarray, turn: list[float]
) -> None:
    evidence, turned = CONTACT.log_weight(force, step), Rotation.from_rotvec(turn)
    assert evidence <= 0.0
    assert CONTACT.log_weight(turned.apply(force), turned.apply(step)) == pytest.approx(
        evidence, rel=1e-6, abs=1e-6
    )


def test_a_segment_is_weighed_by_each_of_its_samples() -> None:
    forces = [np.array([-1.0, 0.5, 4.0]), np.array([2.0, 0.0, 3.0]), np.array([-3.0, 0.0, 1.0])]
    rows = CONTACT.empty()
    for i, one in enumerate(forces):
        rows = CONTACT.extend(rows, ModelInput(i * STEP, one))
    each = [CONTACT.log_weight(forces[0], np.zeros(3)), *(CONTACT.log_weight(f, STEP) for f in forces[1:])]
    np.testing.assert_allclose(CONTACT.log_evidence(rows), np.cumsum(each[::-1])[::-1])
