"""What is taken off a force, what is not, and in which frame it comes out."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from caesura_service.signals import WRENCH_SOURCES, Conditioner, SampleLayout, baseline, wrench_capabilities
from caesura_service.signals.tare import RestCriterion, Tare, tare_of
from caesura_service.signals.wrench_capabilities import HANDS_ON_ROBOT
from service.signals.samples import (
    FORCE,
    POSITION,
    QUATERNION,
    TORQUE,
    along,
    column,
    condition,
    times,
    together,
)

Array = NDArray[np.float64]

COLUMNS = ("t", *POSITION, *FORCE)
LAYOUT = SampleLayout(COLUMNS, wrench_source="flange_sensor")
BIAS = np.array([1.5, -2.5, 4.0])
T = times(500.0, 3.0)


def demonstration(
    *,
    speed_m_per_s: float = 0.0,
    noise_n: float = 0.1,
    contact_n: float = 0.0,
    gap: bool = False,
    source: str = "flange_sensor",
) -> tuple[Conditioner, Array]:
    """Biased force, a contact along z after 2 s; position moves from the start where a speed is given."""
    noise = np.random.default_rng(0).normal(0.0, noise_n, (len(T), 3))
    force = BIAS + noise + along((0.0, 0.0, contact_n), (T > 2.0).astype(float))
    t = T + (0.5 if gap else 0.0) * (T > 0.2)
    conditioner = Conditioner(SampleLayout(COLUMNS, wrench_source=source))
    samples = np.column_stack([t, along((speed_m_per_s, 0.0, 0.0), T), force])
    return conditioner, column(together(conditioner, [samples]).observations, "force_base")


def test_the_bias_at_rest_is_taken_off_everything() -> None:
    conditioner, force = demonstration(contact_n=8.0)
    assert conditioner.tare == pytest.approx(tuple(BIAS), abs=0.05)
    assert "Tared at the start" in conditioner.tare_note
    assert len(force) == 29
    assert_allclose(force[:19], 0.0, atol=0.15)
    assert_allclose(force[21:], [[0.0, 0.0, 8.0]] * 8, atol=0.15)


def test_the_note_has_no_negative_zero() -> None:
    at_rest = tare_of(np.full((3, 3), -0.001), np.zeros(3), RestCriterion(0.01, 1.0), np.full((3, 3), -0.004))
    assert (
        at_rest.note == "Tared at the start: (0.00, 0.00, 0.00) N and (0.00, 0.00, 0.00) Nm are subtracted."
    )


def test_a_sensor_below_the_hand_is_tared_in_free_motion_too() -> None:
    conditioner, force = demonstration(speed_m_per_s=0.1)
    assert conditioner.tare == pytest.approx(tuple(BIAS), abs=0.05)
    assert_allclose(force, 0.0, atol=0.15)


def start_of(force: tuple[float, float, float], speed_m_per_s: float) -> Tare:
    below_the_hand = RestCriterion(
        wrench_capabilities("flange_sensor", "unknown", stated=True).tare_speed_m_per_s, 0.5
    )
    return tare_of(np.tile(np.array(force), (41, 1)), np.full(41, speed_m_per_s), below_the_hand)


@pytest.mark.parametrize("force", [(0.0, 0.0, 17.9), (-12.0, 3.0, -25.0), (0.0, 40.0, 0.0)])
def test_a_force_in_motion_that_nothing_but_a_contact_explains_is_not_tared(
    force: tuple[float, float, float],
) -> None:
    """Of a recording cut from a longer one contact and free space were exchanged, in all that it has."""
    cut = start_of(force, 0.05)
    assert cut.bias is None
    assert "it touched something" in cut.note


@pytest.mark.parametrize(
    ("force", "speed_m_per_s", "is_doubted"),
    [
        ((6.0, 0.0, 5.0), 0.05, False),  # a bias
        ((0.0, 0.0, -18.0), 0.05, True),  # the weight of a tool
        ((4.0, -6.0, -180.0), 0.05, False),  # no hand presses so
        ((0.0, 0.0, 17.9), 0.0, True),  # at rest
        ((0.0, 0.0, 3.0), 0.0, False),
    ],
)
def test_any_other_force_at_the_start_is_tared_and_a_large_one_is_stated(
    force: tuple[float, float, float], speed_m_per_s: float, is_doubted: bool
) -> None:
    tared = start_of(force, speed_m_per_s)
    assert tared.bias == pytest.approx(force)
    assert bool(tared.doubt) == is_doubted
    if is_doubted:
        assert f"{np.linalg.norm(force):.1f} N, taken for the bias" in tared.doubt


def released(
    pressed: tuple[float, float, float], speed_m_per_s: float, torque: bool = False, pieces: int = 1
) -> tuple[Conditioner, Array]:
    """A press at rest for 1 s, then free space, with a movement from 1.5 s on; the sensor has no bias."""
    t = times(500.0, 4.0)
    noise = np.random.default_rng(1).normal(0.0, 0.1, (len(t), 3))
    force = noise + along(pressed, (t < 1.0).astype(float))
    place = along((speed_m_per_s, 0.0, 0.0), np.maximum(t - 1.5, 0.0))
    torques, names = ([0.1 * noise], TORQUE) if torque else ([], ())
    conditioner = Conditioner(SampleLayout((*COLUMNS, *names), wrench_source="flange_sensor"))
    samples = np.column_stack([t, place, force, *torques])
    found = together(conditioner, np.array_split(samples, pieces)).observations
    return conditioner, column(found, "force_base")


@pytest.mark.parametrize("torque", [False, True])
def test_a_tare_that_was_a_contact_is_withdrawn_once_free_motion_shows_it(torque: bool) -> None:
    """All that came after it had contact and free space exchanged, for as long as the session lasted."""
    conditioner, force = released((3.0, 0.0, 16.0), 0.3, torque)
    assert_allclose(force[:9], 0.0, atol=0.2)
    assert_allclose(force[11:15], [[-3.0, 0.0, -16.0]] * 4, atol=0.2)
    assert_allclose(force[20:], 0.0, atol=0.2)
    assert conditioner.tare == (0.0, 0.0, 0.0)
    assert "withdrawn" in conditioner.tare_note
    doubt = conditioner.tare_doubt
    assert "The tare of 16.3 N was no bias: 1.8 s after the start" in doubt
    assert "If it was a contact, contact and free space are exchanged before that" in doubt


@pytest.mark.parametrize("start_s", [0.0, 1.7e9])
def test_the_time_of_a_withdrawal_counts_a_gap(start_s: float) -> None:
    """It was the number of observations, and none describes a gap."""
    conditioner = Conditioner(SampleLayout(COLUMNS, wrench_source="flange_sensor"))
    t = times(500.0, 4.0)
    pressed = along((3.0, 0.0, 16.0), (t < 1.0).astype(float))
    place = along((0.3, 0.0, 0.0), np.maximum(t - 1.5, 0.0))
    later = t + 10.0 * (t > 1.2) + start_s
    together(conditioner, [np.column_stack([later, place, pressed])])
    assert "11.8 s after the start" in conditioner.tare_doubt


def test_a_withdrawn_tare_may_have_been_the_weight_of_a_tool_that_turned() -> None:
    """A sensor zeroed with a tool in another pose; the note stated a contact, and nothing was touched."""
    t = times(500.0, 4.0)
    angle = np.clip((t - 1.0) / 1.5, 0.0, 1.0) * np.pi / 2
    # 1.2 kg, less what it reads in the pose in which it was zeroed: nothing is left there.
    weight = along((0.0, 11.8, 0.0), np.cos(angle)) - along((0.0, 0.0, 11.8), 1.0 - np.sin(angle))
    place, still = along((0.3, 0.0, 0.0), np.maximum(t - 1.0, 0.0)), np.zeros_like(t)
    turned = np.column_stack([np.sin(angle / 2), still, still, np.cos(angle / 2)])
    layout = SampleLayout(("t", *POSITION, *QUATERNION, *FORCE), wrench_source="flange_sensor")
    conditioner = Conditioner(layout)
    together(conditioner, [np.column_stack([t, place, turned, weight])])
    assert "withdrawn" in conditioner.tare_note
    assert "If it was a tool's weight, let the robot compensate it" in conditioner.tare_doubt


def test_a_tare_is_withdrawn_at_the_same_observation_however_samples_come() -> None:
    _, whole = released((3.0, 0.0, 16.0), 0.3)
    for pieces in (7, 400):
        assert_array_equal(released((3.0, 0.0, 16.0), 0.3, pieces=pieces)[1], whole)


@pytest.mark.parametrize(
    ("pressed", "speed_m_per_s"),
    [((0.0, 0.0, -18.0), 0.3), ((4.0, -6.0, -180.0), 0.3), ((3.0, 0.0, 16.0), 0.05), ((0.0, 7.0, 5.0), 0.3)],
    ids=["a weight", "more than a hand presses", "too slow to be free", "a bias"],
)
def test_a_tare_that_may_be_none_else_stays(
    pressed: tuple[float, float, float], speed_m_per_s: float
) -> None:
    conditioner, _ = released(pressed, speed_m_per_s)
    assert conditioner.tare == pytest.approx(pressed, abs=0.05)
    assert "Tared at the start" in conditioner.tare_note


def bias_and_load(
    bias: tuple[float, float, float], friction_n: float, *, freely: bool
) -> tuple[Conditioner, Array]:
    """A sensor with a bias: a fast movement, then what opposes the bias, carried fast from 3 s to 5 s."""
    t = times(500.0, 7.0)
    noise = np.random.default_rng(1).normal(0.0, 0.1, (len(t), 3))
    is_laden, first = (t > 3.0) & (t < 5.0), np.clip(t - 1.0, 0.0, 1.0)
    force = noise + np.array(bias) - along(bias, is_laden.astype(float))
    force -= along((friction_n, 0.0, 0.0), ((t > 1.0) & (t < 2.0)).astype(float))
    place = along((0.3 if freely else 0.05, 0.0, 0.0), first) + along(
        (0.3, 0.0, 0.0), np.clip(t - 3.2, 0.0, 1.5)
    )
    conditioner = Conditioner(SampleLayout(COLUMNS, wrench_source="flange_sensor"))
    found = together(conditioner, [np.column_stack([t, place, force])]).observations
    return conditioner, column(found, "force_base")


def test_a_tare_that_left_no_force_in_a_fast_movement_is_not_withdrawn() -> None:
    """A load of 1.2 kg took a bias of 12 N for a contact, and the rest of the session had none taken off."""
    conditioner, force = bias_and_load((0.0, 0.0, 12.0), 0.0, freely=True)
    assert conditioner.tare == pytest.approx((0.0, 0.0, 12.0), abs=0.05)
    assert "Tared at the start" in conditioner.tare_note
    assert_allclose(force[55:], 0.0, atol=0.2)


@pytest.mark.parametrize(("friction_n", "freely"), [(0.0, False), (3.0, True)], ids=["slow", "it slides"])
def test_a_slow_movement_or_one_with_friction_proves_no_bias(friction_n: float, freely: bool) -> None:
    conditioner, _ = bias_and_load((0.0, 0.0, 16.0), friction_n, freely=freely)
    assert "withdrawn" in conditioner.tare_note


def test_the_bias_is_the_mean_of_the_window_itself() -> None:
    conditioner, force = demonstration(noise_n=0.0)
    assert conditioner.tare == pytest.approx(tuple(BIAS), abs=1e-12)
    assert_allclose(force, 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("start", "reason"),
    [
        ({"speed_m_per_s": 0.3}, "the robot moved at 0.3 m/s"),
        (
            {"speed_m_per_s": 0.05, "source": "flange_sensor_with_hand"},
            "the robot moved at 0.05 m/s",
        ),
        ({"noise_n": 5.0}, "the force varied by"),
        ({"gap": True}, "samples are missing within the tare window"),
    ],
)
def test_without_rest_at_the_start_nothing_is_taken_off(start: dict[str, float], reason: str) -> None:
    conditioner, force = demonstration(**start)  # type: ignore[arg-type]
    assert conditioner.tare is None
    assert reason in conditioner.tare_note
    assert "stays in every force and load" in conditioner.tare_note
    assert conditioner.tare_note.endswith("begin the recording at rest in free space.")
    assert_allclose(force.mean(axis=0), BIAS, atol=1.0)


def test_a_demonstration_that_ends_within_the_window_is_handed_out_untared() -> None:
    conditioner = Conditioner(LAYOUT)
    short = np.column_stack([T, np.zeros((len(T), 3)), np.tile(BIAS, (len(T), 1))])[T < 0.3]
    assert conditioner.push(short).observations == ()
    assert conditioner.observations == 0
    ended = conditioner.finish().observations
    assert_allclose(column(ended, "force_base"), [BIAS] * len(ended), atol=1e-12)
    assert len(ended) == conditioner.observations == 2
    assert "ended within the tare window" in conditioner.tare_note


def test_observations_wait_for_the_tare_no_longer_than_its_window() -> None:
    conditioner = Conditioner(LAYOUT)
    samples = np.column_stack([T, np.zeros((len(T), 3)), np.tile(BIAS, (len(T), 1))])
    late = [s[0, 0] - o.t for s in np.split(samples, len(T)) for o in conditioner.push(s).observations]
    assert max(late) <= 0.4 + conditioner.delay_s
    assert max(late[4:]) <= conditioner.delay_s + 0.002 + 1e-9


def test_without_a_wrench_force_is_zero_and_nothing_waits() -> None:
    layout = SampleLayout(("t", *POSITION, *FORCE), wrench_source="none")
    conditioner = Conditioner(layout)
    samples = np.column_stack([T, np.zeros((len(T), 3)), np.tile(BIAS, (len(T), 1))])
    assert_array_equal(column(conditioner.push(samples[T < 0.3]).observations, "force_base"), 0.0)
    assert conditioner.tare is None
    assert "no wrench" in conditioner.tare_note


def test_a_force_in_the_flange_is_turned_into_the_base() -> None:
    """The flange turns about z by 90° in a second; the force stays along its x."""
    layout = SampleLayout(
        ("t", *POSITION, *QUATERNION, *FORCE), wrench_source="flange_sensor", force_frame="flange"
    )
    half = 0.25 * np.pi * np.clip(T - 1.0, 0.0, 1.0)
    turning = np.stack([0 * T, 0 * T, np.sin(half), np.cos(half)], axis=1)
    pushing = along((6.0, 0.0, 0.0), (T > 0.7).astype(float))
    observations = condition(layout, T, np.zeros((len(T), 3)), turning, pushing)
    assert_allclose(observations[8].force_base, [6.0, 0.0, 0.0], atol=1e-9)
    assert_allclose(observations[14].force_base, [6 * np.sqrt(0.5), 6 * np.sqrt(0.5), 0.0], atol=0.01)
    assert_allclose(observations[-1].force_base, [0.0, 6.0, 0.0], atol=1e-9)


def test_the_orientation_for_the_force_may_come_from_the_joints() -> None:
    upside_down = np.array([1.0, 0.0, 0.0, 0.0])
    layout = SampleLayout(
        ("t", *POSITION, *(f"q{i}" for i in range(1, 8)), *FORCE),
        wrench_source="flange_sensor",
        force_frame="flange",
        pose_of_joints=lambda q: (q[:, :3], np.tile(upside_down, (len(q), 1))),
    )
    pushing = along((1.0, 2.0, 3.0), (T > 0.7).astype(float))
    observations = condition(layout, T, np.zeros((len(T), 3)), np.zeros((len(T), 7)), pushing)
    assert_allclose(observations[-1].force_base, [1.0, -2.0, -3.0], atol=1e-12)


def test_every_source_says_what_it_carries() -> None:
    for source, hand in product(WRENCH_SOURCES, HANDS_ON_ROBOT):
        if (source, hand) == ("flange_sensor_with_hand", "no"):
            continue
        found = wrench_capabilities(source, hand, stated=True)
        expected = source == "flange_sensor" or (source, hand) == ("joint_torque_estimate", "no")
        assert (found.contact_models, found.transport_models) == (expected, expected)
        assert found.bias == ("mixture" if (source, hand) == ("joint_torque_estimate", "no") else "tare")
        assert found.note.startswith(f"Wrench source {source}: ")
        assert ("contact and load are off" in found.note) is not expected
        assert "assumed" not in found.note


@pytest.mark.parametrize(("source", "hand"), [*product(WRENCH_SOURCES, HANDS_ON_ROBOT)])
def test_an_assumed_source_supports_neither_contact_nor_load_and_says_assumed(source: str, hand: str) -> None:
    found = wrench_capabilities(source, hand, stated=False)
    assert (found.contact_models, found.transport_models, found.bias) == (False, False, "tare")
    assert f"Wrench source {source}, assumed: " in found.note


@pytest.mark.parametrize(
    ("columns", "source"),
    [
        (("t", *POSITION, *FORCE), "flange_sensor_with_hand"),
        (("t", *POSITION), "none"),
        (("t", *POSITION, *(f"tau{i}" for i in range(1, 8))), "none"),
    ],
)
def test_an_unstated_source_gets_the_conservative_reading(columns: tuple[str, ...], source: str) -> None:
    layout = SampleLayout(columns)
    assert layout.source_in_use == source
    assert not layout.source.contact_models
    assert "assumed" in layout.source.note


@pytest.mark.parametrize(
    ("stated", "expected"),
    [
        ({"wrench_source": "guess"}, "'guess', expected one of .*joint_torque_estimate"),
        ({"wrench_source": "none", "hand_on_robot": "maybe"}, "'maybe', expected one of .*unknown"),
        (
            {"wrench_source": "flange_sensor_with_hand", "hand_on_robot": "no"},
            "'no', which contradicts wrench_source 'flange_sensor_with_hand'",
        ),
    ],
)
def test_a_statement_that_is_unknown_or_contradicts_itself_is_refused(
    stated: dict[str, str], expected: str
) -> None:
    with pytest.raises(ValueError, match=expected):
        SampleLayout(COLUMNS, **stated)  # type: ignore[arg-type]


def test_two_baselines_weigh_what_was_grasped() -> None:
    rng = np.random.default_rng(3)
    before, after = rng.normal(BIAS, 0.1, (50, 3)), rng.normal(BIAS - [0.0, 0.0, 0.6], 0.1, (50, 3))
    load = baseline(after)[0] - baseline(before)[0]
    assert_allclose(load, [0.0, 0.0, -0.6], atol=0.06)
    assert_allclose(baseline(before)[1], 0.1, rtol=0.3)
    with pytest.raises(ValueError, match="at least one row"):
        baseline(before[:0])
