from __future__ import annotations

import numpy as np
import pytest

from caesura_lab.teacher.level_surface_contact import FingertipContact, Surface

TABLE = Surface(0.1, friction=0.3)
PUMP = Surface(0.1, radius_m=0.03, travel_m=0.025, preload_n=3.0, spring_n_per_m=160.0)


@pytest.mark.parametrize("surface", [TABLE, PUMP])
def test_a_surface_never_pulls(surface: Surface) -> None:
    rng = np.random.default_rng(0)
    for depth, rate in zip(rng.uniform(-0.01, 0.03, 300), rng.uniform(-2.0, 2.0, 300), strict=True):
        assert surface.normal_force(depth, rate) >= 0.0


@pytest.mark.parametrize("force", [5.0, 12.0, 21.0])
@pytest.mark.parametrize("surface", [TABLE, PUMP])
def test_depth_and_force_are_inverse(surface: Surface, force: float) -> None:
    assert surface.static_force(surface.depth_for(force)) == pytest.approx(force)


def test_a_dispenser_yields_over_its_travel_and_then_stops() -> None:
    assert PUMP.static_force(0.024) == pytest.approx(3.0 + 160.0 * 0.024)
    assert PUMP.static_force(0.026) > PUMP.static_force(0.025) + 15.0


def test_beside_a_surface_there_is_nothing() -> None:
    assert FingertipContact([PUMP]).force((0.05, 0.0, 0.09), (0.0, 0.0, 0.0), 0.001) == (0.0, 0.0, 0.0)


def test_the_highest_surface_is_touched() -> None:
    force = FingertipContact([Surface(0.05), TABLE]).force((0.0, 0.0, 0.0995), (0.0, 0.0, 0.0), 0.001)
    assert force[2] == pytest.approx(TABLE.static_force(0.0005))


def test_friction_holds_then_slips_at_coulombs_limit() -> None:
    touch, position, normal = FingertipContact([TABLE]), (0.0, 0.0, 0.0995), TABLE.static_force(0.0005)
    creeping = [touch.force(position, (0.001, 0.0, 0.0), 0.001)[0] for _ in range(50)]
    assert -0.3 * normal < creeping[-1] < 0.0
    sliding = [touch.force(position, (0.2, 0.1, 0.0), 0.001) for _ in range(50)][-1]
    assert np.hypot(sliding[0], sliding[1]) == pytest.approx(0.3 * normal)
    assert sliding[0] / sliding[1] == pytest.approx(2.0, abs=0.2)


def test_contact_takes_energy_and_gives_none() -> None:
    touch, height, speed, dt, mass = FingertipContact([TABLE]), 0.101, -0.2, 1e-4, 5.0
    for _ in range(10000):
        speed += dt * (touch.force((0.0, 0.0, height), (0.0, 0.0, speed), dt)[2] / mass)
        height += dt * speed
    assert 0.0 <= speed < 0.2


def test_a_load_that_is_gripped_already_rests_on_the_table() -> None:
    still = ((0.0, 0.0, TABLE.touch_height_m - 0.001), (0.0, 0.0, 0.0), 0.001)
    empty, gripped = (
        FingertipContact((TABLE,)).force(*still),
        FingertipContact((TABLE,)).force(*still, load_n=2.5),
    )
    assert gripped[2] == pytest.approx(empty[2] + 2.5)
