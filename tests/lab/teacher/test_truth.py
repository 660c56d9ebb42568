"""Truth from states made by hand, where the right answer is plain to see."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from caesura_lab.teacher.contact_and_motion_spans import TrueState
from caesura_lab.teacher.truth import annotate

Array = NDArray[np.float64]


def state(
    seconds: float, moves: list[tuple[float, float, tuple[float, float, float]]], **more: Array
) -> TrueState:
    """Constant velocity [m/s] within each move (from, to, velocity), rest elsewhere."""
    t = np.arange(round(1000 * seconds)) / 1000
    velocity = np.zeros((t.size, 3))
    for begin, end, speed in moves:
        velocity[(t >= begin) & (t < end)] = speed
    nothing = np.zeros(t.size)
    return TrueState(t, velocity, more.get("normal", nothing), more.get("load_kg", nothing))


def during(seconds: float, begin: float, end: float, value: float) -> Array:
    t = np.arange(round(1000 * seconds)) / 1000
    return np.where((t >= begin) & (t < end), value, 0.0)


def classes(truth: dict[str, Any]) -> list[str]:
    return [s["cls"] for s in truth["segments"]]


def majors(truth: dict[str, Any]) -> list[tuple[str, float]]:
    return [(c["kind"], round(c["t"], 1)) for c in truth["changepoints"] if c["level"] == "major"]


def test_a_rest_of_half_a_second_parts_two_movements() -> None:
    truth = annotate(state(5.0, [(1.0, 2.0, (0.1, 0, 0)), (2.6, 4.0, (0.1, 0, 0))]))
    assert classes(truth) == ["steady", "motion", "steady", "motion", "steady"]
    assert majors(truth) == [("start", 1.0), ("stop", 2.0), ("start", 2.6), ("stop", 4.0)]


def test_a_shorter_rest_is_optional() -> None:
    truth = annotate(state(5.0, [(1.0, 2.0, (0.1, 0, 0)), (2.2, 4.0, (0.1, 0, 0))]))
    assert classes(truth) == ["steady", "motion", "steady"]
    assert [(c["kind"], c["level"]) for c in truth["changepoints"]][1] == ("dip", "optional")


def test_a_turn_through_a_dip_is_a_corner() -> None:
    truth = annotate(state(5.0, [(1.0, 2.0, (0.1, 0, 0)), (2.2, 4.0, (0, 0.1, 0))]))
    assert ("corner", 2.1) in [(kind, t) for kind, t in majors(truth)] or ("corner", 2.0) in majors(truth)


def test_a_small_correction_is_optional_and_unclear() -> None:
    truth = annotate(state(5.0, [(1.0, 2.0, (0.1, 0, 0)), (3.0, 3.3, (0.015, 0, 0))]))
    assert classes(truth) == ["steady", "motion", "steady", "steady"]
    assert majors(truth) == [("start", 1.0), ("stop", 2.0)]


def test_contact_edges_are_major_and_the_decay_optional() -> None:
    normal = during(5.0, 2.0, 3.5, 15.0) + during(5.0, 3.5, 4.0, 3.0)
    truth = annotate(state(5.0, [(0.5, 2.0, (0, 0, -0.1)), (4.0, 4.6, (0, 0, 0.1))], normal=normal))
    assert classes(truth) == ["steady", "motion", "contact", "motion", "steady"]
    assert [kind for kind, _ in majors(truth)] == ["start", "contact_on", "contact_off", "stop"]
    assert [c["t"] for c in truth["changepoints"] if c["kind"] == "decay"] == pytest.approx([3.5], abs=0.05)
    assert truth["forces"] == [{"t0": 2.0, "t1": 4.0, "newton": 15.0}]


def test_what_gives_way_is_pushed_in_by_a_motion() -> None:
    """As annotators read real recordings; ideal people press, whatever gives way."""
    normal = during(5.0, 2.0, 4.0, 15.0)
    pushing = state(5.0, [(1.0, 2.6, (0, 0, -0.05)), (4.0, 4.6, (0, 0, 0.1))], normal=normal)
    truth = annotate(pushing, guided=True)
    assert classes(truth) == ["steady", "motion", "sliding", "contact", "motion", "steady"]
    assert [kind for kind, _ in majors(truth)] == ["start", "contact_on", "stop", "contact_off", "stop"]
    assert classes(annotate(pushing)) == ["steady", "motion", "contact", "motion", "steady"]


def test_a_load_that_touches_and_is_not_pressed_has_no_force() -> None:
    """The median of no values was written as a force of NaN N, which no judge reads."""
    touch = {"normal": during(5.0, 2.0, 2.2, 3.0), "load_kg": during(5.0, 1.0, 5.0, 0.5)}
    truth = annotate(state(5.0, [], **touch))
    assert [kind for kind, _ in majors(truth) if "contact" in kind] == ["contact_on", "contact_off"]
    assert truth["forces"] == []


def test_a_bounce_is_one_contact_and_a_graze_none() -> None:
    normal = during(5.0, 1.0, 1.05, 20.0) + during(5.0, 1.1, 2.0, 8.0) + during(5.0, 3.0, 3.02, 5.0)
    truth = annotate(state(5.0, [], normal=normal))
    assert [(f["t0"], f["t1"]) for f in truth["forces"]] == [(1.0, 2.0)]


def test_motion_in_contact_is_sliding() -> None:
    truth = annotate(state(5.0, [(2.0, 3.5, (0.1, 0, 0))], normal=during(5.0, 1.0, 4.5, 10.0)))
    assert classes(truth) == ["steady", "contact", "sliding", "contact", "steady"]


def test_what_is_dropped_in_the_air_is_no_longer_held() -> None:
    truth = annotate(state(4.0, [], load_kg=during(4.0, 0.0, 2.0, 0.3)))
    assert [(s["cls"], s["t1"]) for s in truth["segments"]] == [("hold", 2.0), ("steady", 4.0)]
    assert truth["loads"] == [{"t0": 0.0, "t1": 2.0, "kg": 0.3}]


def test_a_load_is_carried_from_lift_off_to_touch_down() -> None:
    normal = during(6.0, 0.5, 1.5, 10.0) + during(6.0, 4.0, 5.0, 10.0)
    load = during(6.0, 1.0, 4.6, 0.3)
    truth = annotate(state(6.0, [(2.0, 3.5, (0.1, 0, 0))], normal=normal, load_kg=load))
    assert truth["loads"] == [{"t0": 1.5, "t1": 4.0, "kg": 0.3}]
    assert classes(truth) == ["steady", "contact", "hold", "transport", "hold", "contact", "steady"]
    assert truth["gripper"] == [{"t": 1.0, "event": "grasp"}, {"t": 4.6, "event": "release"}]


def test_a_turn_just_before_a_touch_is_no_event_of_its_own() -> None:
    touched = during(5.0, 2.1, 3.5, 8.0)
    truth = annotate(state(5.0, [(1.0, 1.95, (0.1, 0, 0)), (2.05, 2.5, (0, 0.1, 0))], normal=touched))
    levels = {c["kind"]: c["level"] for c in truth["changepoints"] if 1.9 < c["t"] < 2.2}
    assert levels["contact_on"] == "major"
    assert set(levels.values()) == {"major", "optional"}


def test_no_event_is_reported_twice() -> None:
    """A slip too small to be a movement, just before the contact, takes the rest beside it."""
    moves = [(0.5, 1.9, (0.1, 0, 0)), (1.98, 2.0, (0.02, 0, 0))]
    truth = annotate(state(4.0, moves, normal=during(4.0, 2.0, 3.0, 8.0)))
    reported = [(c["kind"], c["t"]) for c in truth["changepoints"]]
    assert len(reported) == len(set(reported))
    assert all(s["t0"] < s["t1"] for s in truth["segments"])


def test_the_force_that_is_taught_is_the_effort_without_the_load() -> None:
    normal = during(4.0, 1.0, 2.0, 15.0) + during(4.0, 2.0, 3.0, 17.4525)
    truth = annotate(state(4.0, [], normal=normal, load_kg=during(4.0, 2.0, 4.0, 0.25)))
    assert truth["forces"] == [{"t0": 1.0, "t1": 3.0, "newton": 15.0}]


def turning(
    seconds: float,
    turns: list[tuple[float, float, tuple[float, float, float]]],
    moves: list[tuple[float, float, tuple[float, float, float]]] = (),  # type: ignore[assignment]
    **more: Array,
) -> TrueState:
    """Constant rate [rad/s] within each turn (from, to, rate), beside moves of the tip."""
    moved, turned = state(seconds, moves, **more), state(seconds, turns)
    return TrueState(moved.t, moved.velocity, moved.normal, moved.load_kg, turned.velocity)


def test_a_turn_in_place_is_turning_in_the_air_in_contact_and_with_a_load() -> None:
    turns = [(1.0, 2.0, (0, 0, 1.0)), (4.0, 5.0, (0, 1.0, 0)), (7.0, 8.0, (1.0, 0, 0))]
    more = {"normal": during(9.0, 3.0, 6.0, 10.0), "load_kg": during(9.0, 6.0, 9.0, 0.3)}
    truth = annotate(turning(9.0, turns, **more), guided=True)
    kinds = ["steady", "turning", "steady", "contact", "turning", "contact", "hold", "turning", "hold"]
    assert classes(truth) == kinds
    assert [t for kind, t in majors(truth) if kind in ("start", "stop")] == [1.0, 2.0, 4.0, 5.0, 7.0, 8.0]
    assert truth["loads"] == [{"t0": 6.0, "t1": 9.0, "kg": 0.3}]


def test_a_turn_slower_than_a_tenth_of_a_radian_a_second_is_none() -> None:
    truth = annotate(turning(6.0, [(1.0, 1.5, (0, 0, 0.03)), (3.0, 4.0, (0, 0, 0.5))]), guided=True)
    assert classes(truth) == ["steady", "turning", "steady"]
    assert majors(truth) == [("start", 3.0), ("stop", 4.0)]


def test_what_travels_and_turns_is_motion() -> None:
    truth = annotate(turning(5.0, [(1.1, 2.1, (0, 0, 1.0))], [(1.0, 2.0, (0.2, 0, 0))]), guided=True)
    assert classes(truth) == ["steady", "motion", "steady"]
    assert majors(truth) == [("start", 1.0), ("stop", 2.1)]


def test_a_tip_that_strays_a_little_still_turns_in_place() -> None:
    truth = annotate(turning(5.0, [(1.0, 2.0, (0, 0, 1.5))], [(1.2, 1.8, (0.04, 0, 0))]), guided=True)
    assert classes(truth) == ["steady", "turning", "steady"]


def test_a_turn_that_goes_on_after_a_movement_is_a_segment_of_its_own() -> None:
    truth = annotate(turning(5.0, [(1.5, 3.0, (0, 0, 1.0))], [(1.0, 2.0, (0.2, 0, 0))]), guided=True)
    assert classes(truth) == ["steady", "motion", "turning", "steady"]
    assert majors(truth) == [("start", 1.0), ("start", 2.0), ("stop", 3.0)]


def test_edges_of_a_movement_and_a_turn_within_a_rest_are_one() -> None:
    truth = annotate(turning(5.0, [(2.2, 3.2, (0, 0, 1.0))], [(1.0, 2.0, (0.2, 0, 0))]), guided=True)
    assert classes(truth) == ["steady", "motion", "turning", "steady"]
    assert [t for _, t in majors(truth)] == [1.0, 2.1, 3.2]


def test_a_turn_that_is_reversed_has_a_corner() -> None:
    turns = [(1.0, 2.0, (0, 0, 1.0)), (2.1, 3.1, (0, 0, -1.0))]
    truth = annotate(turning(5.0, turns), guided=True)
    assert classes(truth) == ["steady", "turning", "steady"]
    assert [kind for kind, _ in majors(truth)] == ["start", "corner", "stop"]


def test_a_movement_that_returns_to_its_start_is_no_small_one() -> None:
    moves = [(1.0, 2.0, (0.1, 0, 0)), (2.0, 3.0, (-0.1, 0, 0))]
    truth = annotate(turning(5.0, [], moves), guided=True)
    assert classes(truth) == ["steady", "motion", "steady"]


def marked(truth: dict[str, Any], kind: str) -> list[tuple[str, float]]:
    return [(c["level"], round(c["t"], 1)) for c in truth["changepoints"] if c["kind"] == kind]


def heading(speed: float, degrees: float) -> tuple[float, float, float]:
    return (speed * float(np.cos(np.radians(degrees))), speed * float(np.sin(np.radians(degrees))), 0.0)


@pytest.mark.parametrize(
    ("degrees", "level"), [(35.0, None), (43.0, "optional"), (48.0, "optional"), (60.0, "major")]
)
def test_a_turn_within_5_degrees_of_the_limit_is_left_open(degrees: float, level: str | None) -> None:
    moves = [
        (1.0, 2.0, (0.1, 0, 0)),
        (2.0, 2.1, heading(0.02, 0.5 * degrees)),
        (2.1, 3.0, heading(0.1, degrees)),
    ]
    truth = annotate(state(4.0, moves), guided=True)
    assert [found for found, _ in marked(truth, "corner")] == ([level] if level else [])


def test_a_turn_of_which_two_readings_disagree_is_left_open() -> None:
    """At the dip the path turns by 90°, but between the peaks it has turned back."""
    aside = [(2.0, 2.1, (0.02, 0, 0)), (2.1, 2.4, heading(0.06, 90.0)), (2.4, 3.4, (0.1, 0, 0))]
    truth = annotate(state(5.0, [(1.0, 2.0, (0.1, 0, 0)), *aside]), guided=True)
    assert [level for level, _ in marked(truth, "corner")] == ["optional"]


def test_a_dip_of_a_fifth_of_the_speed_is_visible_and_optional() -> None:
    moves = [(1.0, 2.0, (0.1, 0, 0)), (2.0, 2.2, (0.08, 0, 0)), (2.2, 3.0, (0.1, 0, 0))]
    assert marked(annotate(state(4.0, moves), guided=True), "dip") == [("optional", 2.0)]
    assert marked(annotate(state(4.0, moves)), "dip") == []  # ideal people do not hesitate


@pytest.mark.parametrize(("creep", "level"), [(0.003, "major"), (0.007, "optional")])
def test_a_rest_by_one_reading_only_is_left_open(creep: float, level: str) -> None:
    """Below 10 mm/s it rests, below 5 mm/s it does not."""
    moves = [(1.0, 2.0, (0.1, 0, 0)), (2.0, 2.4, (creep, 0, 0)), (2.4, 3.4, (0.1, 0, 0))]
    truth = annotate(state(5.0, moves), guided=True)
    assert [found for found, t in marked(truth, "stop") if t == 2.0] == [level]
    assert [found for found, t in marked(truth, "start") if t == 2.4] == [level]
    rests = [s for s in truth["segments"] if s["cls"] == "steady" and 1.9 < s["t0"] < 2.1]
    assert len(rests) == (1 if level == "major" else 0)


def test_a_pause_of_a_traced_movement_by_one_reading_only_is_left_open() -> None:
    """Tracing at 8 mm/s is a movement from 4 mm/s on; at 4.5 mm/s it rests by the other reading."""
    slow, traced = (0.0045, 0, 0), (0.008, 0, 0)
    moves = [(1.0, 1.5, slow), (1.5, 4.0, traced), (4.0, 4.6, slow), (4.6, 7.0, traced), (7.0, 7.2, slow)]
    truth = annotate(state(9.0, moves), guided=True)
    assert majors(truth) == [("start", 1.0), ("stop", 7.2)]
    accepted = [c.get("t_alt") for c in truth["changepoints"] if c["level"] == "major"]
    assert accepted == [pytest.approx(1.5, abs=0.05), None]  # 0.2 s at the end are no pause
    assert ("optional", 4.0) in marked(truth, "stop")
    assert ("optional", 4.6) in marked(truth, "start")


def test_a_release_that_lasts_is_accepted_at_either_end() -> None:
    normal = during(5.0, 2.0, 3.5, 15.0) + during(5.0, 3.5, 4.0, 3.0)
    truth = annotate(state(5.0, [(0.5, 2.0, (0, 0, -0.1))], normal=normal), guided=True)
    (release,) = [c for c in truth["changepoints"] if c["kind"] == "contact_off"]
    assert (release["t"], release["t_alt"]) == pytest.approx((4.0, 3.5), abs=0.05)
    assert [level for level, _ in marked(truth, "decay")] == ["optional"]


def test_a_rest_that_a_contact_or_an_end_of_the_recording_cuts_has_an_optional_edge() -> None:
    """Rests of 0.2 s: before the first movement, after a contact, and after the last movement."""
    moves = [(0.2, 2.0, (0, 0, -0.1)), (3.2, 4.8, (0, 0, 0.1))]
    truth = annotate(state(5.0, moves, normal=during(5.0, 2.0, 3.0, 10.0)), guided=True)
    assert majors(truth) == [("contact_on", 2.0), ("contact_off", 3.0)]
    assert marked(truth, "start") == [("optional", 0.2), ("optional", 3.2)]
    assert marked(truth, "stop") == [("optional", 4.8)]
    assert [s["cls"] for s in truth["segments"]] == ["motion", "contact", "motion"]


def test_of_a_corner_and_a_stop_close_by_only_the_stop_counts() -> None:
    moves = [(1.0, 2.0, (0.1, 0, 0)), (2.0, 2.05, (0.02, 0, 0)), (2.05, 2.2, (0, 0.1, 0))]
    truth = annotate(state(4.0, moves), guided=True)
    assert marked(truth, "stop") == [("major", 2.2)]
    assert "major" not in [level for level, _ in marked(truth, "corner")]
