"""The round trip's verdict, one trip, and a few of the mutated programs."""

from __future__ import annotations

import re
from io import StringIO
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from caesura_lab.evaluation.programs import program_mutations, program_round_trip
from caesura_lab.evaluation.programs.program_round_trip import (
    RoundTripCase,
    RoundTripResult,
    compare_programs,
    exerted_errors,
    run_round_trip,
    stated_errors,
    summarise,
)
from caesura_protocol.messages import App, RestForce
from caesura_protocol.programs.app_time_shifts import run_times
from harness.once import once_a_version
from harness.programs import press, pressed_harder_before

CASE = RoundTripCase("dispenser", 1)


def executed(index: int = 0, **fields: Any) -> tuple[App, ...]:
    apps = [app.model_copy(update={"force_taught": app.force}) for app in press()]
    apps[index] = apps[index].model_copy(update=fields)
    return tuple(apps)


@pytest.mark.parametrize(
    ("again", "why"),
    [
        (executed(), None),
        (executed(0, target=(-0.02, -0.52, 0.199)), None),
        (executed(0, target=(-0.02, -0.52, 0.201)), r"target of app 1 \(move to contact\) is 11.0 mm off"),
        (executed(1, force_taught=(0.0, 0.0, -11.4)), None),
        (executed(1, force_taught=(0.0, 0.0, -11.6)), "a force is .16 % off"),
        (executed(1, force_taught=None), "a force is -100 % off"),
        (executed(1, target=None), r"target of app 2 .* is nan mm off"),
        (executed(1, kind="hold"), r"app 2 \(hold\) was taught as apply force"),
        (executed()[:2], r"app 3 \(move\) is missing"),
        ((*executed(), executed()[0]), r"app 4 \(move to contact\) is one too many"),
    ],
)
def test_a_trip_holds_when_apps_targets_and_forces_do(again: tuple[App, ...], why: str | None) -> None:
    trip = compare_programs(CASE, press(), again)
    if why is None:
        assert trip.why is None
    else:
        assert trip.why is not None
        assert re.search(why, trip.why), trip.why


@pytest.mark.parametrize(
    ("measured", "forces"),
    [
        (RestForce(newton=9.0, newton_taught=9.0), (0.0, -0.25, 0.0)),
        (None, (0.0, 0.0)),
    ],
)
def test_the_force_of_a_rest_is_compared_where_both_programs_state_it(
    measured: RestForce | None, forces: tuple[float, ...]
) -> None:
    apps = pressed_harder_before()
    again = tuple(app.model_copy(update={"force_taught": app.force}) for app in apps)
    again = (again[0], again[1].model_copy(update={"rest_before": measured}))
    assert compare_programs(CASE, apps, again).force == pytest.approx(forces)


def test_the_exerted_force_is_compared_on_the_path_and_in_each_rest_beside_it() -> None:
    """A program asks for 12 N, 10 N and 5 N; the run has 12 N all the time."""
    touch, stroke = pressed_harder_before()
    ended = 1.0 + stroke.tn - stroke.t0
    contact = np.tile((0.0, 0.0, 12.0), (round(1000 * ended), 1))
    errors = [*exerted_errors((touch, stroke), [(0.0, 1.0), (1.0, ended)], contact)]
    assert errors == pytest.approx([0.0, 0.2, 1.4])


def test_the_stated_force_is_compared_with_that_of_the_hand_while_it_pressed() -> None:
    """A program states 18 N, 10 N and 5 N; the hand pressed with 12 N, after an impact of 40 N."""
    touch, stroke = pressed_harder_before()
    stroke = stroke.model_copy(update={"force_taught": stroke.force})
    t0, tn = run_times(stroke)
    contact = np.tile((0.0, 0.0, 12.0), (round(1000 * tn), 1))
    contact[round(1000 * t0) :][:20] *= 40.0 / 12.0
    contact[round(1000 * stroke.path.tn) - 100 : round(1000 * stroke.path.tn)] *= 0.5  # the hand lets go
    assert [*stated_errors((touch, stroke), contact)] == pytest.approx([0.5, -1.0 / 6.0, -7.0 / 12.0])


def test_the_table_counts_what_holds_and_says_why_the_others_do_not() -> None:
    good = RoundTripResult(CASE, ("a",), ("a",), (0.001, 0.003), (0.02,), None)
    bad = RoundTripResult(RoundTripCase("dispenser", 2), ("a",), ("b",), (), (), "app 1 is b, taught was a")
    console = Console(width=90, record=True, file=StringIO())
    console.print(program_round_trip.page(summarise([bad, good]), "title").as_text())
    text = console.export_text()
    assert "1/2" in text
    assert "app 1 is b, taught was a" in text


@pytest.mark.slow
@pytest.mark.parametrize("speed", ["taught", "optimal"])
def test_one_person_goes_round(speed: Any) -> None:
    trip = once_a_version(run_round_trip)(RoundTripCase("dispenser", 501, speed=speed))
    assert trip.why is None
    assert max(trip.target_m) < 0.01
    assert max(map(abs, trip.exerted)) < 0.06


@pytest.mark.slow
@pytest.mark.parametrize("number", [2, 5, 9, 14, 18, 45])
def test_a_spoilt_program_is_refused_or_stays_within_its_limits(number: int) -> None:
    fate = once_a_version(program_mutations.run_mutation)(number)
    assert fate.outcome != "violation", fate


def test_mutations_are_the_same_each_time_and_change_something() -> None:
    different = 0
    for number in range(40):
        first, again = (program_mutations.mutate(press(), np.random.default_rng(number)) for _ in range(2))
        assert repr(first) == repr(again)
        different += repr(first[1]) != repr(list(press()))
    assert different > 30
