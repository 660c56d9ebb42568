"""Where between observations a boundary lies, on movements whose starts, stops and corners are known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from caesura_service.constants import CREEP_M_PER_S, HANDS_BREADTH_M, REST_M_PER_S
from caesura_service.signals import Observation, SampleLayout
from caesura_service.signals.backend import REFERENCE, Backend, best
from service.signals.samples import FORCE, POSITION, QUATERNION, along, condition, positions_only, times

Array = NDArray[np.float64]

EARLY_S = [0.0, 0.02, 0.04, 0.06, 0.08]  # from an observation to the event
ROW_S = 0.01  # of the grid
MOST_S = 0.09  # from the middle between two observations to the place
T = times(1000.0, 4.0)


def places(observations: list[Observation]) -> dict[int, float]:
    """[s] where a boundary lies, by the observation that a segment starts with."""
    return {o.index - 1: o.boundary_before for o in observations if o.boundary_before is not None}


def start_at(observations: list[Observation], t: float) -> float:
    """[s] the place of the start whose middle is nearest to a time [s]."""
    found = places(observations)
    return found[min(found, key=lambda index: abs(observations[index].t - 0.05 - t))]


def stroke(begin: float, speed: float = 0.1) -> Callable[[Array], Array]:
    """A way [m] at a speed that rises from `begin` [s] on within 0.2 s and falls 1.2 s later as fast."""

    def way(t: Array) -> Array:
        rising, falling = (np.clip(t - at, 0.0, 0.2) for at in (begin, begin + 1.2))
        return speed * (rising**2 / 0.4 + np.clip(t - begin - 0.2, 0.0, None)) - speed * (
            falling**2 / 0.4 + np.clip(t - begin - 1.4, 0.0, None)
        )

    return way


@pytest.mark.parametrize("early_s", EARLY_S)
def test_a_movement_starts_and_stops_where_its_speed_passes_that_of_rest(early_s: float) -> None:
    observations = positions_only(T, stroke(1.0 + early_s))
    passes = 0.2 * REST_M_PER_S / 0.1  # [s] from no speed to that of rest
    assert start_at(observations, 1.0 + early_s) == pytest.approx(1.0 + early_s + passes, abs=2 * ROW_S)
    assert start_at(observations, 2.4 + early_s) == pytest.approx(2.4 + early_s - passes, abs=2 * ROW_S)


@pytest.mark.parametrize("early_s", EARLY_S)
def test_a_movement_ends_at_a_corner_where_it_is_slowest(early_s: float) -> None:
    observations = positions_only(T, lambda t: 0.1 * t + 0.02 * np.cos(4.0 * (t - 2.0 - early_s)))
    slowest = 2.0 + early_s + 0.5 * np.pi / 4.0
    assert start_at(observations, slowest) == pytest.approx(slowest, abs=1.5 * ROW_S)


@pytest.mark.parametrize("early_s", EARLY_S)
def test_a_turn_is_as_fast_as_a_point_at_a_hands_breadth(early_s: float) -> None:
    layout = SampleLayout(("t", *POSITION, *QUATERNION), wrench_source="none")
    angle = stroke(1.0 + early_s)(T) / HANDS_BREADTH_M
    quaternion = np.column_stack([along((0.0, 0.0, 1.0), np.sin(0.5 * angle)), np.cos(0.5 * angle)])
    observations = condition(layout, T, np.zeros((T.size, 3)), quaternion)
    assert start_at(observations, 1.02 + early_s) == pytest.approx(1.02 + early_s, abs=2 * ROW_S)


def test_a_rest_slower_than_creep_leaves_a_boundary_in_the_middle() -> None:
    observations = positions_only(T, lambda t: 0.9 * CREEP_M_PER_S * t)
    found = places(observations)
    assert len(found) > 30
    assert all(place == pytest.approx(observations[i].t - 0.05) for i, place in found.items())


def test_a_change_of_the_force_leaves_a_boundary_to_its_contact() -> None:
    force = along((0.0, 0.0, 1.0), np.where(T < 2.25, 0.0, 8.0))

    def found(source: str) -> set[int]:
        layout = SampleLayout(("t", *POSITION, *FORCE), wrench_source=source, force_frame="base")
        way = along((1.0, 0.0, 0.0), stroke(1.0)(T))
        return set(places(condition(layout, T, way, force)))

    assert found("flange_sensor_with_hand") - found("flange_sensor") == {21, 22, 23}


def test_no_place_is_known_beside_a_gap_nor_at_the_ends() -> None:
    layout = SampleLayout(("t", *POSITION), wrench_source="none")
    t = np.concatenate([T[T < 1.5], T[T > 2.5]])
    observations = condition(layout, t, along((1.0, 0.0, 0.0), 0.1 * t))
    (gap,) = [o.index for o in observations if o.after_gap]
    known = set(places(observations))
    assert not known & {0, gap - 1, gap, len(observations) - 1}
    assert {gap - 2, gap + 2} <= known


def test_no_place_is_further_off_than_the_observations_beside_it() -> None:
    generator = np.random.default_rng(3)
    observations = positions_only(T, lambda t: np.cumsum(generator.normal(0.0, 3e-5, t.size)))
    found = places(observations)
    off = [place - (observations[i].t - 0.05) for i, place in found.items()]
    assert np.abs(off).max() == pytest.approx(MOST_S)


@pytest.mark.parametrize("arithmetic", [REFERENCE, best()], ids=["reference", "best"])
@pytest.mark.parametrize(
    ("speeds", "row"),
    [
        ([1.0, 2.0, 12.0, 2.0, 2.0, 14.0, 20.0], 5),  # it leaves rest for the last time
        ([20.0, 14.0, 9.0, 2.0, 12.0, 2.0, 1.0], 2),  # it comes to rest for the first
        ([20.0, 14.0, 11.0, 12.0, 13.0, 18.0, 20.0], 2),  # a dip
        ([20.0, 9.0, 1.0, 2.0, 13.0, 18.0, 20.0], 2),  # a dip to rest
        ([9.0, 8.0, 7.0, 6.0, 5.0, 4.0, 3.0], 0),  # it has come to rest before
        ([1.0, 4.0, 4.9, 4.0, 2.0, 2.0, 3.0], 3),  # nothing but rest
        ([20.0] * 7, 0),
    ],
)
def test_the_row_of_a_boundary(speeds: list[float], row: int, arithmetic: Backend) -> None:
    seen = 1e-3 * np.array([50.0, *speeds, 0.0])
    assert arithmetic.boundary_row(seen, 1, 7, CREEP_M_PER_S, REST_M_PER_S) == row + 1
