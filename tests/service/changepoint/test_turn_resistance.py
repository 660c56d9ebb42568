"""A torque that is held divides turns: what weighs a step, and what no lever and no frame changes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from caesura_service.changepoint.channel_model import ModelInput
from caesura_service.changepoint.channel_model_checks import rows_after
from caesura_service.changepoint.preset import Preset
from caesura_service.changepoint.presets import PRESETS, WITHOUT
from caesura_service.changepoint.turn_resistance import TurnResistance, torsion_of

PRESS = np.array([0.0, 0.0, 12.0])
DRIVEN, IDLE = TurnResistance(least=0.2), TurnResistance(most=0.2)


def turn(torque_nm: float, *, about: tuple[float, float, float] = (0.0, 0.0, -1.0)) -> list[ModelInput]:
    """Four steps of 0.1 rad under 12 N, with a torque about the force."""
    torsion = np.array([0.0, 0.0, torque_nm])
    rotations = np.outer(0.1 * np.arange(5), about)
    return [ModelInput(np.zeros(3), PRESS, np.nan, rotation, torsion) for rotation in rotations]


def weight(model: TurnResistance, observed: list[ModelInput]) -> float:
    return float(model.log_evidence(rows_after(model, observed))[0])


def test_a_turn_against_a_torque_is_driven_and_one_without_is_idle() -> None:
    size = 0.8 * 0.1 / math.hypot(0.1, DRIVEN.pace)
    assert weight(DRIVEN, turn(0.8)) == pytest.approx(4 * math.log1p(-math.exp(-0.5 * (size / 0.2) ** 2)))
    assert weight(IDLE, turn(0.8)) == pytest.approx(-4 * 0.5 * (0.8 / 0.2) ** 2)
    assert weight(IDLE, turn(0.0)) == 0.0
    assert weight(DRIVEN, turn(0.0)) < -100.0
    assert weight(DRIVEN, turn(-0.8)) < -100.0, "a torque that turns it is no resistance"


def test_a_tilt_of_what_is_pressed_is_no_screwing() -> None:
    tilted = turn(0.8, about=(1.0, 0.0, 0.0))
    assert weight(DRIVEN, tilted) == weight(IDLE, tilted) == 0.0


def test_the_torsion_is_the_same_about_every_point_and_turns_with_the_base() -> None:
    rng = np.random.default_rng(0)
    force, torque, lever = 10.0 * rng.normal(size=(3, 3))
    here = torsion_of(force, torque)
    assert torsion_of(force, torque + np.cross(lever, force)) == pytest.approx(here, abs=1e-9)
    base = Rotation.random(rng=rng)
    assert torsion_of(base.apply(force), base.apply(torque)) == pytest.approx(base.apply(here), abs=1e-9)
    assert not torsion_of(np.array([0.0, 0.0, 3.0]), torque).any(), "the bias has no direction to speak of"
    assert not torsion_of(force, None).any()


@pytest.mark.parametrize("preset", [PRESETS["default"], WITHOUT["without_torque"]], ids=lambda one: one.name)
def test_without_a_torque_there_is_one_kind_of_turn_in_contact(preset: Preset) -> None:
    lattice = preset.lattice(orientation=True)
    (kind,) = (kind for kind in lattice.kinds if (kind.name, kind.contact) == ("turning", "contact"))
    assert kind.weight == 1.0
    assert not {"resisted", "unresisted"} & {*lattice.channels}
    assert len(preset.lattice(orientation=True, torque=True).kinds) == len(lattice.kinds) + 1
