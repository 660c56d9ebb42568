"""The thesis suite: what counts as a row that came out, who teaches, and what is said of it."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from caesura_lab.commands import register
from caesura_lab.evaluation.scoring.metrics import TimedEstimate
from caesura_lab.evaluation.thesis import suite, table_row_comparison
from caesura_lab.evaluation.thesis.reference_segments import ROWS, ThesisBoundary, ThesisRow
from caesura_lab.evaluation.thesis.simulated_demonstrations import (
    DRAWN,
    HUMAN,
    NO_GRIPPER,
    ROBOT,
    SENSOR,
    TIMED,
    SuiteDemonstration,
    person,
)
from caesura_lab.evaluation.thesis.suite import MAIN, OPEN, SuiteSetting, Task, run_task, tasks
from caesura_lab.evaluation.thesis.summary import summarise
from caesura_lab.evaluation.thesis.table_row_comparison import (
    SAME_EVENT_S,
    ConditionedDemonstration,
    FoundDivision,
    RowOutcome,
    differences,
    pair_boundaries,
    present_since,
    references,
)
from caesura_lab.ground_truth import TrueChangepoint, Truth
from caesura_lab.teacher import simulated_teaching
from caesura_lab.teacher.motion_profiles import UNIT_RESPONSES, time_of_share
from caesura_lab.teacher.person import THESIS
from caesura_protocol.recording import Recording
from caesura_service.changepoint.channel_model import ChannelModel, ModelInput, Noise
from caesura_service.changepoint.hazard import Geometric, Uniform
from caesura_service.changepoint.offline_posterior import segment_offline
from caesura_service.changepoint.presets import PRESETS
from caesura_service.offline_segmentation import views
from lab.teacher.nominal import nominal_once

ROW = ThesisRow(
    "R", "Fig.", "s", "force", (ThesisBoundary(2.0), ThesisBoundary(4.0), ThesisBoundary(4.5)), states="12?1"
)
RIGHT = [(2.0,), (4.0, 4.2), (4.5,)]
# How fast the forces of Fig. 4.13 and 4.14 fall: before [N], after [N], time [s].
DECAYS = ((21.086, 2.411, 0.5), (20.331, 4.083, 0.4), (14.986, 3.283, 0.6), (9.881, 2.524, 0.4))
DECAYS_PER_S = [np.log(before / after) / time for before, after, time in DECAYS]
DECAY_ASIDE = ((-0.278, -0.631, -0.203), (-1.139, 0.419, 0.094))  # x, y [N] at 3.5, 4.1, 4.2 s
NAMED = {row.name: row for row in ROWS}


@pytest.fixture(autouse=True)
def simulated_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each demonstration of the suite is simulated once."""
    monkeypatch.setattr(simulated_teaching, "teach", nominal_once)


def found(*inner: float, states: str = "1221") -> FoundDivision:
    return FoundDivision(inner, states, (0.0,) * len(states), (0.0,) * len(states))


def evidence(model: ChannelModel, forces: np.ndarray) -> float:
    rows = model.empty()
    for force in forces:
        rows = model.extend(rows, ModelInput(np.zeros(3), force))
    return float(model.log_evidence(rows)[0])


def seen(*points: TrueChangepoint, path: np.ndarray | None = None) -> ConditionedDemonstration:
    t = np.arange(0.0, 6.0, 0.01)
    pos = np.zeros((t.size, 3)) if path is None else path
    return table_row_comparison.condition_demonstration(
        Recording(t, {"pos": pos}), Truth("x", (0.0, 6.0), points)
    )


def test_the_table_is_consistent():
    for row in ROWS:
        times = [boundary.t for boundary in row.inner]
        assert times == sorted(set(times))
        assert len(row.states) in (0, row.segments)
        assert set(row.states) <= set("123?")
        assert all(value.segment < row.segments for value in row.values)
        assert row.preset in PRESETS
        assert row.scenario in TIMED
        assert times[-1] < TIMED[row.scenario].steps[-1].until_s
    assert {f"R{n}" for n in range(1, 14)} == {name.split(".")[0].split()[0] for name in NAMED}


def test_demonstrations_are_as_long_as_the_thesis_says():
    ends = {name: scenario.steps[-1].until_s for name, scenario in TIMED.items()}
    assert ends == {"three_point": 15.1, "parkour": 8.9, "pick_and_place": 12.8, "dispenser": 12.2}
    for scenario in TIMED.values():
        times = [step.until_s for step in scenario.steps]
        assert times == sorted(set(times))


def test_a_person_differs_from_the_thesis_in_body_and_sensors_only():
    drawn = person(3, "overdamped")
    differing = {f.name for f in fields(drawn) if getattr(drawn, f.name) != getattr(THESIS, f.name)}
    assert differing == {"name", "profile", *DRAWN, *ROBOT, *NO_GRIPPER, *HUMAN["overdamped"]}
    assert person(3, "overdamped") == drawn != replace(person(4, "overdamped"), name=drawn.name)
    assert all(getattr(drawn, name) == value for name, value in SENSOR.items())
    assert person(3, "overdamped", wander=True).bias_wander_n != THESIS.bias_wander_n
    assert person(3, "overdamped").hand_kg == 0.0
    assert person(3, "overdamped", gripper=True).hand_kg == THESIS.hand_kg > 0.0


def test_only_the_thesis_own_human_controls_a_force():
    assert person(3, "overdamped").force_rate_per_s == pytest.approx(np.mean(DECAYS_PER_S), abs=0.05)
    assert person(3, "minimum_jerk").force_rate_per_s is None


def test_the_aim_below_a_surface_is_that_of_the_thesis():
    fall, below = 0.244 - 0.107, HUMAN["overdamped"]["impact_m"]
    duration = 1.8 / time_of_share("overdamped", fall / (fall + below))
    done = (fall + below) * UNIT_RESPONSES["overdamped"](np.array([0.8 / duration]))[0]
    assert done == pytest.approx(0.244 - 0.164, abs=0.002)  # Fig. 4.8


def test_the_hand_leaves_the_placed_object_when_the_thesis_does():
    recording, _ = SuiteDemonstration("pick_and_place", 101, "overdamped").load()
    heights = np.interp([10.3, 10.4, 10.8, 11.3], recording.t, recording.signals["pos"][:, 2])
    assert heights == pytest.approx([0.104, 0.105, 0.166, 0.263], abs=0.012)  # Fig. 4.8, 4.12, 4.17


@pytest.mark.parametrize("fall", [np.linspace, np.geomspace])
def test_the_thesis_own_decay_is_called_free_only_with_the_nu0_of_its_force_model(fall):
    """The forces of Fig. 4.14 and 4.15 at 4.1 and 4.2 s; from 3.6 s on, between that at 3.5 s and those."""
    x, y = (np.append(np.linspace(a, b, 7)[1:], c) for a, b, c in DECAY_ASIDE)
    forces = np.column_stack([x, y, np.append(fall(14.986, 3.283, 7)[1:], 1.076)])

    def free_over_contact(preset: str) -> float:
        channels = PRESETS[preset].channels(1.0)
        return evidence(channels["untouched"], forces) - evidence(channels["pressed"], forces)

    assert abs(free_over_contact("integrated_tab_4_5")) < 0.5
    assert free_over_contact("integrated") > 9.0


def test_only_the_nu0_of_a_press_differs_between_the_presets_of_the_integrated_model():
    forces = np.random.default_rng(5).normal(0.0, 3.0, (12, 3))
    force, integrated, printed = (
        PRESETS[name].channels(1.0) for name in ("force", "integrated", "integrated_tab_4_5")
    )
    assert evidence(integrated["pressed"], forces) == evidence(force["pressed"], forces)
    assert evidence(printed["pressed"], forces) != evidence(force["pressed"], forces)
    assert (integrated["pressed"].noise, printed["pressed"].noise) == (Noise(10.0, 1.25), Noise(1.0, 1.25))
    others = set(integrated) - {"pressed", "moving"}
    assert {name: integrated[name] for name in others} == {name: printed[name] for name in others}
    assert integrated["moving"].noise == printed["moving"].noise == Noise(1.0, 0.025)


def test_offline_a_segment_has_any_length_unless_a_mean_is_set(monkeypatch: pytest.MonkeyPatch):
    asked = []

    def spy(lattice, hazard, data):
        asked.append(hazard)
        return segment_offline(lattice, hazard, data)

    monkeypatch.setattr(table_row_comparison, "segment_offline", spy)
    still = Recording(
        np.arange(0.0, 3.0, 0.01),
        {"pos": np.zeros((300, 3)), "force": np.zeros((300, 3))},
        wrench_source="flange_sensor",
    )
    demonstration = table_row_comparison.condition_demonstration(still, Truth("x", (0.0, 3.0), ()))
    for any_length in (True, False):
        table_row_comparison.divide(demonstration, PRESETS["integrated"], 0.2, any_length=any_length)
    assert asked == [Uniform(len(demonstration.conditioned.observations)), Geometric(20.0)]


def test_what_the_thesis_says_has_no_faults():
    assert list(differences(ROW, found(2.0, 4.0, 4.5), RIGHT)) == []
    assert list(differences(ROW, found(1.7, 4.5, 4.8, states="1231"), RIGHT)) == []


@pytest.mark.parametrize(
    ("division", "faults"),
    [
        (found(1.69, 4.0, 4.5), ["2.0 early"]),
        (found(2.0, 4.51, 4.5), ["4.0 late"]),
        (found(2.0, 4.0, 4.5, states="1321"), ["2 is 3 in segment 2"]),
        (found(2.0, 4.0, states="121"), ["no 4.5"]),
        (found(2.0, 3.0, 4.0, 4.5, states="12221"), ["1 more after 2.0"]),
        (found(states="1"), ["no 2.0", "no 4.0", "no 4.5"]),
    ],
)
def test_every_difference_is_named(division: FoundDivision, faults: list[str]):
    assert list(differences(ROW, division, RIGHT)) == faults


def test_one_changepoint_stands_for_one_boundary():
    assert pair_boundaries([4.25], RIGHT) == [None, 0, None]
    assert pair_boundaries([4.25, 4.3], RIGHT) == [None, 0, 1]
    assert pair_boundaries([], RIGHT) == [None, None, None]


def test_an_event_counts_beside_the_thesis_time_unless_it_is_another_one():
    row = ThesisRow("R", "Fig.", "s", "force", (ThesisBoundary(2.0, "contact_on"),))
    near, far = (TrueChangepoint(2.0 + by, 0.15, kind="contact_on") for by in (0.4, SAME_EVENT_S + 0.1))
    assert references(row, seen(near, far)) == [(2.0, 2.4)]
    assert references(row, seen(far)) == [(2.0,)]
    assert references(row, seen(replace(near, kind="decay"))) == [(2.0,)]
    twice = replace(row, inner=(ThesisBoundary(2.0, also=1.5),))
    assert references(twice, seen(near)) == [(2.0, 1.5)]


def test_a_place_is_where_the_hand_comes_nearest():
    row = ThesisRow("R", "Fig.", "s", "force", (ThesisBoundary(2.0, (0.25, 0.0, 0.0)),))
    path = np.column_stack([0.1 * np.arange(0.0, 6.0, 0.01), *np.zeros((2, 600))])
    assert references(row, seen(path=path)) == [(2.0, pytest.approx(2.5))]


def test_a_delay_is_until_a_boundary_is_there_for_good():
    timed_estimates = [
        TimedEstimate(2.1, (2.0,), (False,)),
        TimedEstimate(2.2, (), ()),
        TimedEstimate(2.5, (2.1,), (False,)),
    ]
    assert present_since(timed_estimates, [(2.0,)]) == [2.5]
    assert present_since(timed_estimates[:2], [(2.0,)]) == [None]


def test_a_row_passes_with_nine_of_ten_seeds_and_soon_enough():
    row = NAMED["R13"]
    name, n = row.name, len(row.inner)

    def passes(failing: int, delay_s: float) -> bool:
        outcomes = [
            RowOutcome(name, i, 8, ("no 3.5",) if i < failing else (), delays_s=(delay_s,) * n)
            for i in range(10)
        ]
        return summarise([{"a": outcomes}])["a"][name].passes

    assert passes(1, 0.15)
    assert not passes(2, 0.15)
    assert not passes(1, 0.25)


def test_each_demonstration_is_simulated_once_for_all_settings_that_share_it():
    settings = (
        *MAIN,
        SuiteSetting("longer", mean_segment_s=4.0),
        SuiteSetting("cm", length_unit_m=0.1, rows=("R1",)),
    )
    work = tasks([1, 2], settings)
    assert len(work) == len({task.taught for task in work}) == 2 * 2 * len(TIMED)
    names = {task.taught.scenario: [s.name for s in task.settings] for task in work if task.taught.seed == 1}
    assert names["parkour"] == ["minimum jerk"]
    shared = next(task for task in work if task.taught == SuiteDemonstration("three_point", 1, "overdamped"))
    assert [setting.name for setting in shared.settings] == ["overdamped", "longer", "cm"]


def test_a_setting_changes_what_it_names():
    assert MAIN[0].preset("force") is PRESETS["force"]
    assert SuiteSetting("x", mean_segment_s=4.0).preset("force").mean_segment_s == 4.0
    assert SuiteSetting("x", window=31).conditioning.filter.delay_s == pytest.approx(0.15)
    other = SuiteSetting("x", length_unit_m=0.5).preset("constant_velocity").channels(1.0)["moving"]
    assert other.length_unit_m == 0.5
    printed = SuiteSetting("x", integrated="integrated_tab_4_5")
    assert printed.judged(NAMED["R13"]).preset == "integrated_tab_4_5"
    assert printed.judged(NAMED["R9"]) is NAMED["R9"]


def test_the_rows_of_the_integrated_model_are_also_judged_with_the_nu0_of_its_own_table():
    (printed,) = (setting for setting in OPEN if setting.integrated != "integrated")
    assert printed.name == printed.integrated == "integrated_tab_4_5"
    judged = {row.name for row in ROWS if row.preset == "integrated"}
    assert {row.name for row in ROWS if printed.measures(row)} == judged == {"R10", "R11", "R13"}


@pytest.mark.slow
def test_an_online_row_is_measured_with_the_preset_of_its_setting(monkeypatch: pytest.MonkeyPatch):
    asked = []

    def spy(recording, preset, *, threshold):
        asked.append(preset)
        return views(recording, preset, threshold=threshold)

    monkeypatch.setattr(table_row_comparison, "views", spy)
    pair = tuple(
        SuiteSetting(name, integrated=name, online=True, rows=("R13",))
        for name in ("integrated", "integrated_tab_4_5")
    )
    run_task(Task(SuiteDemonstration("pick_and_place", 101, "overdamped"), pair))
    assert asked == ["integrated", "integrated_tab_4_5"]


@pytest.mark.slow
def test_the_thesis_three_points_come_out_on_a_simulated_demonstration():
    only = SuiteSetting("overdamped", rows=("R4",))
    (outcome,) = run_task(Task(SuiteDemonstration("three_point", 101, "overdamped"), (only,)))["overdamped"]
    assert outcome == RowOutcome("R4", 101, 6, ())


@pytest.mark.slow
def test_the_command_shows_the_same_in_every_format(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    small = tuple(replace(setting, rows=("R4",)) for setting in MAIN)
    monkeypatch.setattr(suite, "tasks", lambda seeds: tasks(seeds, small))
    monkeypatch.setattr(suite, "run_task", cache(run_task))
    app, out = typer.Typer(), tmp_path / "out.json"
    register(app)

    def run(*arguments: object) -> str:
        common = ("evaluate", "--suite", "thesis", "--seeds", "1", "--first-seed", "101", "--workers", "1")
        result = CliRunner().invoke(app, [*common, *map(str, arguments)])
        assert result.exit_code == 0, result.output
        return result.stdout

    text = run()
    assert max(map(len, text.splitlines())) <= 80
    assert "pass 100% (6)" in " ".join(text.split())
    assert "| R4 | three_point | second_order_1 | 6 | pass 100% (6) |" in run("--format", "markdown")
    run("--format", "json", "-o", out)
    settings = json.loads(out.read_text())["settings"]
    assert settings["overdamped"]["R4"]["share"] == 1.0
    assert settings["minimum jerk"]["R4"]["passes"] == (settings["minimum jerk"]["R4"]["share"] >= 0.9)


def test_the_suite_has_every_scenario_of_its_rows():
    assert set(suite.SCENARIOS) == set(TIMED)
