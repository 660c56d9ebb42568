"""Every method finds an obvious change, and nothing where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from caesura_lab.evaluation.baselines.conditioned_signals import Signals, grid_signals
from caesura_lab.evaluation.baselines.simple_baselines import switched
from caesura_lab.evaluation.baselines.third_party_baselines import gaussian_online
from caesura_lab.evaluation.methods import PresetMethod, baselines
from caesura_protocol.recording import Recording

RATE_HZ = 200.0
ALL = [PresetMethod("default"), *baselines()]
WITHOUT_FORCE = ("zero velocity", "BOCPD speed")
FLOORS = ("one segment", "every second")  # which do not look at the signals
FINDING = [method for method in ALL if method.name not in FLOORS]


def recording(*, moves: bool = False, presses: bool = False, source: str = "flange_sensor") -> Recording:
    """Rest, then from 3 s to 5 s a movement of 0.2 m, from 7 s on a press with 15 N."""
    t = np.arange(0.0, 10.0, 1.0 / RATE_HZ)
    rng = np.random.default_rng(0)
    x = np.clip((t - 3.0) / 2.0, 0.0, 1.0)
    position, force = np.zeros((t.size, 3)), rng.normal(0.0, 0.1, (t.size, 3))
    position[:, 0] = moves * 0.2 * (10 * x**3 - 15 * x**4 + 6 * x**5)
    position += rng.normal(0.0, 1e-5, position.shape)
    force[:, 2] += 15.0 * presses * (t > 7.0)
    return Recording(t, {"pos": position, "force": force}, wrench_source=source)


@pytest.mark.parametrize("method", FINDING, ids=lambda method: method.name)
def test_where_nothing_happens_nothing_is_found(method):
    found = method.segment(recording())
    assert found.changepoints == ()
    assert [part.kind for part in found.parts] == ["steady"]


def test_the_floors_look_at_nothing():
    every_second, one_segment = (method.segment(recording(moves=True)) for method in ALL[-2:])
    assert np.diff(every_second.changepoints) == pytest.approx([1.0] * 8)
    assert one_segment.changepoints == ()


@pytest.mark.parametrize("method", FINDING, ids=lambda method: method.name)
def test_a_movement_is_found(method):
    found = method.segment(recording(moves=True))
    for t in (3.0, 5.0):
        assert min(abs(time - t) for time in found.changepoints) < 0.35
    assert "motion" in [part.kind for part in found.parts]


@pytest.mark.parametrize(
    "method", [m for m in FINDING if m.name not in WITHOUT_FORCE], ids=lambda method: method.name
)
def test_a_press_is_found_unless_the_hand_is_in_the_wrench(method):
    found = method.segment(recording(presses=True))
    assert min(abs(time - 7.0) for time in found.changepoints) < 0.2
    assert found.parts[-1].kind == "contact"
    assert method.segment(recording(presses=True, source="flange_sensor_with_hand")).changepoints == ()


@pytest.mark.parametrize("method", ALL, ids=lambda method: method.name)
def test_parts_join_and_the_same_recording_gives_the_same(method):
    taught = recording(moves=True, presses=True)
    found = method.segment(taught)
    assert [part.t0 for part in found.parts[1:]] == list(found.changepoints)
    assert [part.t1 for part in found.parts[:-1]] == list(found.changepoints)
    assert method.segment(taught) == found


def test_the_method_states_what_it_had_inferred_when():
    timed_estimates = PresetMethod("default").segment(recording(moves=True)).timed_estimates
    assert [look.t for look in timed_estimates] == sorted(look.t for look in timed_estimates)
    assert timed_estimates[-1].t <= 10.0
    assert all(timed_estimates[-1].final)


def test_a_trigger_holds_between_its_thresholds():
    values = np.array([2.0, 4.0, 2.0, 0.5, 2.0])
    assert switched(values, on=3.0, off=1.0).tolist() == [False, True, True, False, False]


def test_a_recording_too_short_to_look_at_is_refused():
    with pytest.raises(ValueError, match="expected at least 2"):
        grid_signals(Recording(np.array([0.0, 0.01]), {"pos": np.zeros((2, 3))}, wrench_source="none"))


@pytest.mark.parametrize("first", [20, 31, 44])
@pytest.mark.parametrize("force_shows_contact", [False, True])
def test_the_gaussian_baseline_starts_a_segment_at_its_first_observation(
    first: int, force_shows_contact: bool
):
    """It named the last observation of the segment before, and so all its boundaries were 0.1 s early."""
    rng = np.random.default_rng(first)
    velocity = rng.normal(0.0, 0.002, (80, 3))
    velocity[first:] += 0.2
    velocity[first + 25 :] -= 0.4
    signals = Signals(
        t=0.1 * np.arange(80),
        position_base=np.zeros((80, 3)),
        velocity_base=velocity,
        speed=np.linalg.norm(velocity, axis=1),
        force_base=rng.normal(0.0, 0.1, (80, 3)),
        holding=np.zeros(80, dtype=bool),
        force_shows_contact=force_shows_contact,
        tared=True,
    )
    assert gaussian_online(signals).tolist() == [first, first + 25]
