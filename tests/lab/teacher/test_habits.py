"""Whole demonstrations by people with habits, and the truth about them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from caesura_lab.teacher.contact_and_motion_spans import TrueState
from caesura_lab.teacher.habits import IDEAL
from caesura_lab.teacher.person import THESIS, draw_person, habits_stream, with_habits
from caesura_lab.teacher.simulated_teaching import Demonstration, SimulatedTeaching
from caesura_lab.teacher.truth import annotate
from lab.teacher.nominal import nominal_once

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


def natural(scenario: str, seed: int) -> Demonstration:
    return nominal_once(scenario, seed=seed, natural=True)


def state(parts: list[tuple[float, tuple[float, float, float]]]) -> TrueState:
    """Velocities [m/s], one after the other, each for a time [s]; smoothed over 0.1 s."""
    rows = [np.tile(velocity, (round(1000 * seconds), 1)) for seconds, velocity in parts]
    velocity = np.concatenate(rows).astype(np.float64)
    kernel = np.hanning(100) / np.hanning(100).sum()
    smooth = np.column_stack([np.convolve(axis, kernel, mode="same") for axis in velocity.T])
    nothing = np.zeros(len(smooth))
    return TrueState(np.arange(len(smooth)) / 1000.0, smooth, nothing, nothing)


def majors(state: TrueState) -> list[tuple[str, float]]:
    marks = annotate(state, guided=True)["changepoints"]
    return [(m["kind"], m["t"]) for m in marks if m["level"] == "major"]


REST, EAST, NORTH = (0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.1, 0.0)


def test_creep_below_10_mm_a_second_is_rest() -> None:
    creep = (0.008, 0.0, 0.0)
    found = majors(state([(1.0, REST), (1.0, EAST), (0.8, creep), (1.0, REST)]))
    assert [kind for kind, _ in found] == ["start", "stop"]
    assert found[1][1] == pytest.approx(2.0, abs=0.1)


def test_a_movement_starts_after_a_small_correction_before_it() -> None:
    small = (0.018, 0.0, 0.0)
    before = state([(1.0, REST), (0.4, small), (0.15, REST), (1.0, EAST), (1.0, REST)])
    found = majors(before)
    assert [kind for kind, _ in found] == ["start", "stop"]
    assert found[0][1] == pytest.approx(1.55, abs=0.1)
    optional = [m["t"] for m in annotate(before, guided=True)["changepoints"] if m["level"] == "optional"]
    assert optional == [pytest.approx(1.0, abs=0.1)]


def test_a_slow_approach_to_a_contact_makes_no_stop_before_it() -> None:
    approach = (0.018, 0.0, 0.0)
    touched = state([(1.0, REST), (1.0, EAST), (0.1, REST), (0.4, approach), (1.0, REST)])
    assert [kind for kind, _ in majors(touched)] == ["start", "stop"]
    normal = np.where(touched.t > 2.5, 5.0, 0.0)
    assert [kind for kind, _ in majors(replace(touched, normal=normal))] == ["start", "contact_on"]


def test_tracing_is_motion() -> None:
    trace = (0.009, 0.0, 0.0)
    found = majors(state([(1.0, REST), (4.0, trace), (1.0, REST)]))
    assert [kind for kind, _ in found] == ["start", "stop"]
    assert [t for _, t in found] == pytest.approx([1.0, 5.0], abs=0.1)


def test_a_pause_below_300_ms_is_optional_and_a_longer_one_is_not() -> None:
    for pause, count in ((0.2, 2), (0.6, 4)):
        paused = state([(1.0, REST), (1.0, EAST), (pause, REST), (1.0, EAST), (1.0, REST)])
        assert len(majors(paused)) == count
        kinds = {m["kind"] for m in annotate(paused, guided=True)["changepoints"]}
        assert ("dip" in kinds) == (count == 2)


def test_a_slow_corner_counts() -> None:
    east, north, slow = (0.013, 0.0, 0.0), (0.0, 0.013, 0.0), (0.003, 0.003, 0.0)
    found = majors(state([(1.0, REST), (2.0, east), (0.2, slow), (2.0, north), (1.0, REST)]))
    assert [kind for kind, _ in found] == ["start", "corner", "stop"]


def test_a_corner_with_a_short_leg_is_a_correction() -> None:
    turned = (0.0, 0.06, 0.0)
    found = majors(state([(1.0, REST), (1.0, EAST), (0.1, REST), (0.12, turned), (1.0, REST)]))
    assert [kind for kind, _ in found] == ["start", "stop"]


def test_a_second_peak_and_a_curve_are_no_boundary() -> None:
    angles = np.linspace(0.0, np.pi / 2, 20)
    arc = [(0.1, (0.1 * np.cos(a), 0.1 * np.sin(a), 0.0)) for a in angles]
    peaks = [(0.5, EAST), (0.3, (0.05, 0.0, 0.0)), (0.5, EAST)]
    for parts in (arc, peaks):
        found = majors(state([(1.0, REST), *parts, (1.0, REST)]))
        assert [kind for kind, _ in found] == ["start", "stop"]


def test_habits_leave_the_person_of_a_seed_alone() -> None:
    ideal, person = (SimulatedTeaching("curves", seed=9, natural=n).person for n in (False, True))
    assert ideal.habits == IDEAL
    assert person.habits != IDEAL
    assert (person.name, person.speed_factor, person.load_kg) == (
        ideal.name,
        ideal.speed_factor,
        ideal.load_kg,
    )


def test_the_thesis_person_gets_habits_only_where_asked() -> None:
    assert SimulatedTeaching("curves").person == THESIS
    assert SimulatedTeaching("curves", natural=True).person.habits != IDEAL


def test_a_scenario_of_curves_is_three_movements() -> None:
    truth = nominal_once("curves").truth
    kinds = [m["kind"] for m in truth["changepoints"] if m["level"] == "major"]
    assert kinds == ["start", "stop"] * 3


def test_tracing_by_ideal_people_is_two_traces_between_two_moves() -> None:
    truth = nominal_once("tracing").truth
    kinds = [m["kind"] for m in truth["changepoints"] if m["level"] == "major"]
    assert [kind for kind in kinds if kind != "corner"] == ["start", "stop"] * 4
    traces = [s for s in truth["segments"] if s["cls"] == "motion" and s["t1"] - s["t0"] > 4.0]
    assert len(traces) == 2


@pytest.mark.slow
@pytest.mark.parametrize("seed", [11, 12])
def test_the_truth_of_guided_movements_has_contacts_as_before(seed: int) -> None:
    demonstration: Demonstration = natural("dispenser", seed)
    kinds = [m["kind"] for m in demonstration.truth["changepoints"] if m["level"] == "major"]
    assert kinds.count("contact_on") == kinds.count("contact_off") == 2
    assert len(demonstration.truth["forces"]) == 2


@pytest.mark.slow
def test_some_presses_are_brief() -> None:
    shortest = []
    for seed in (21, 23):
        shortest += [f["t1"] - f["t0"] for f in natural("button", seed).truth["forces"]]
    assert min(shortest) < 0.8
    assert max(shortest) > 1.0


def test_people_with_habits_have_a_bias_that_wanders_by_newtons() -> None:
    ranges = []
    for scenario, seed in (("button", 23), ("dispenser", 12)):  # which other tests look at too
        recording, truth = natural(scenario, seed).recording, natural(scenario, seed).truth
        rests = [s for s in truth["segments"] if s["cls"] == "steady" and s["t1"] - s["t0"] > 0.5]
        t, force = recording.t, recording.signals["force"]
        assert len(rests) == 3
        levels = [np.median(force[(t > s["t0"]) & (t < s["t1"])], axis=0) for s in rests]
        ranges.append(float(np.linalg.norm(np.ptp(levels, axis=0))))
    assert 1.0 < np.median(ranges) < 5.0


def test_habits_are_drawn_from_their_own_stream() -> None:
    person = draw_person(np.random.default_rng(4), "person-4")
    assert with_habits(person, habits_stream(4)) == with_habits(person, habits_stream(4))
    assert with_habits(person, habits_stream(4)) != with_habits(person, habits_stream(5))
