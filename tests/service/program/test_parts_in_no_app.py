"""What of a demonstration is in no app is a note of its program."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from caesura_protocol.messages import App, Segment
from caesura_service.program import Paths, detours, parts_in_no_app_note
from harness.programs import app, move
from service.program.segments import GRASP, moment_at, program, segment

TEACH_AGAIN = ". Teach it again where the robot is to do it."


def pressed(newton: float) -> dict[str, Any]:
    return {"force_end": (0.0, 0.0, newton), "force_held": (0.0, 0.0, newton)}


def note(*segments: Segment, paths: Paths | None = None) -> str | None:
    """Of a hand that moves upwards with 100 mm/s all the time (`moment_at`)."""
    return parts_in_no_app_note(segments, program(*segments, paths=paths), moment_at)


def test_a_tap_that_is_too_short_for_an_app_is_named_with_its_force():
    found = note(segment("motion", 0.0, 2.0), segment("contact", 2.0, 2.2, **pressed(24.0)), MOVED)
    assert found == f"Taught and in no app: a contact of 24.0 N at 2.0–2.2 s{TEACH_AGAIN}"


MOVED = segment("motion", 2.2, 4.0)


def test_a_contact_that_goes_on_in_that_of_an_app_is_none_that_is_lost():
    first, second = segment("contact", 2.0, 2.2, **pressed(9.0)), segment("contact", 2.2, 3.0, **pressed(9.0))
    assert note(segment("motion", 0.0, 2.0), first, second, segment("motion", 3.0, 4.0)) is None


def test_what_is_left_of_a_press_in_an_app_is_none_that_is_lost():
    press, read_as_rest = segment("contact", 2.0, 3.0, **pressed(9.0)), segment("steady", 3.0, 3.4)
    app = program(segment("motion", 0.0, 2.0), press)[-1].model_copy(update={"segments": (1, 2)})
    rest = segment("contact", 3.4, 3.5, **pressed(9.0))
    found = parts_in_no_app_note((segment("motion", 0.0, 2.0), press, read_as_rest, rest), (app,), moment_at)
    assert found is not None
    assert "contact" not in found


def test_a_tool_that_bounces_before_it_is_pressed_lost_no_contact():
    found = note(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 2.1, **pressed(11.0)),
        segment("motion", 2.1, 2.3),
        segment("contact", 2.3, 4.0, **pressed(15.0)),
    )
    assert found is None


def test_a_contact_beside_a_press_that_is_stronger_than_the_press_is_named():
    # An impact of 34 N directly before a press of 20 N was taken as a bounce, and a check found nothing.
    found = note(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 2.1, **pressed(24.0)),
        segment("motion", 2.1, 2.3),
        segment("contact", 2.3, 4.0, **pressed(20.0)),
    )
    assert found == f"Taught and in no app: a contact of 24.0 N at 2.0–2.1 s{TEACH_AGAIN}"
    first, second = (
        segment("contact", 2.0, 2.2, **pressed(24.0)),
        segment("contact", 2.2, 3.0, **pressed(9.0)),
    )
    found = note(segment("motion", 0.0, 2.0), first, second, segment("motion", 3.0, 4.0))
    assert found == f"Taught and in no app: a contact of 24.0 N at 2.0–2.2 s{TEACH_AGAIN}"


def test_motion_before_the_first_app_and_after_the_last_one_is_named():
    found = note(segment("motion", 0.0, 0.2), segment("steady", 0.2, 1.0), segment("motion", 1.0, 2.0))
    assert found == f"Taught and in no app: 100 mm at 0.0–1.0 s, before the first app{TEACH_AGAIN}"
    found = note(segment("motion", 1.0, 2.0), segment("steady", 2.0, 2.5), segment("motion", 2.5, 2.7))
    assert found == f"Taught and in no app: 70 mm at 2.0–2.7 s, after the last app{TEACH_AGAIN}"


@pytest.mark.parametrize("segments", [(), (segment("steady", 0.0, 4.0),)])
def test_without_apps_there_is_nothing_to_compare(segments: tuple[Segment, ...]):
    assert note(*segments) is None


def test_of_many_touches_the_strongest_are_named():
    taps = [
        one
        for k in range(7)
        for one in (segment("motion", k, k + 0.8), segment("contact", k + 0.8, k + 1, **pressed(10.0 + k)))
    ]
    said = note(*taps, segment("motion", 7.0, 8.0))
    assert said is not None
    assert "contact of 11.0 N" not in said
    assert "a contact of 12.0 N at 2.8–3.0 s; " in said
    assert said.endswith(f"; 2 weaker contacts{TEACH_AGAIN}")


@pytest.mark.parametrize(
    ("force", "grips", "is_named"),
    [
        ((0.0, 0.0, -8.0), (GRASP,), False),
        ((0.0, 0.0, -20.0), (GRASP,), True),
        ((6.0, 0.0, -3.0), (GRASP,), True),
        ((0.0, 0.0, 8.0), (GRASP,), True),
        ((0.0, 0.0, -8.0), (), True),  # nothing shows that something was grasped: the knife may have pulled
    ],
)
def test_the_weight_of_what_is_lifted_is_no_contact_that_is_lost(force, grips, is_named):
    """A weight of 8 N before its carry, seen as a contact for 0.2 s, had to be taught again."""
    segments = (
        segment("motion", 0.0, 0.4),
        segment("steady", 0.4, 2.0),
        segment("contact", 2.0, 2.2, force_start=force, force_end=force, force_held=force),
        segment("transport", 2.2, 4.0, load_kg=0.8, load_sd_kg=0.02),
    )
    found = parts_in_no_app_note(segments, program(*segments, grips=grips), moment_at)
    assert ("a contact of" in (found or "")) == is_named


@pytest.mark.parametrize(("newton", "is_named"), [(8.0, False), (20.0, True)])
def test_the_weight_of_what_is_shaken_is_no_contact_that_is_lost(newton: float, is_named: bool) -> None:
    """A bottle of 8 N was shaken: short contacts with its weight, amid its hold, had to be taught again."""
    force = (0.0, 0.0, -newton)
    segments = (
        segment("hold", 0.0, 2.0, load_kg=0.8, load_sd_kg=0.02),
        segment("transport", 2.0, 2.1, load_kg=0.8, load_sd_kg=0.02),
        segment("contact", 2.1, 2.3, force_start=force, force_end=force, force_held=force),
        segment("transport", 2.3, 2.4, load_kg=0.8, load_sd_kg=0.02),
        segment("hold", 2.4, 4.0, load_kg=0.8, load_sd_kg=0.02),
    )
    (carried,) = (one for one in program(*segments, grips=(replace(GRASP, t=-1.0),)) if one.kind == "hold")
    carried = carried.model_copy(update={"t0": 0.0, "tn": 4.0, "segments": (0, 4)})
    grasp = app("grasp", 0.0, 0.0, (0.0, 0.0, 0.0), gripper_width=0.05)
    found = parts_in_no_app_note(segments, (grasp, carried), moment_at)
    assert ("a contact of" in (found or "")) == is_named


# --- detours ------------------------------------------------------------------------------------------------

A, B, C = (0.4, 0.0, 0.3), (0.4, 0.1, 0.3), (0.4, 0.2, 0.3)
TIMES = np.arange(0.0, 300.0, 0.1)


def led(
    *bumps: tuple[float, float, float], turns: tuple[tuple[float, float, float], ...] = ()
) -> NDArray[np.float64]:
    """Poses (n, 7) of a hand that moves from A to B in the first second and to C in the last one.

    bumps: from, to [s] and how far off [m], upwards; turns: likewise [rad], about the vertical.
    """
    y = 0.1 * np.clip(TIMES, 0.0, 1.0) + 0.1 * np.clip(TIMES - (TIMES[-1] - 1.0), 0.0, 1.0)
    up, half = np.zeros((2, TIMES.size))
    for t0, tn, metres in bumps:
        up[(t0 <= TIMES) & (tn >= TIMES)] = metres
    for t0, tn, radians in turns:
        half[(t0 <= TIMES) & (tn >= TIMES)] = 0.5 * radians
    zero = np.zeros(TIMES.size)
    return np.column_stack([zero + 0.4, y, 0.3 + up, zero, zero, np.sin(half), np.cos(half)])


def found(poses: NDArray[np.float64], *between: App) -> list[str]:
    """The detours of a program that moves in the first and in the last second."""
    apps = (move(0.0, A, B), *between, move(float(TIMES[-1]) - 1.0, B, C))
    return list(detours(apps, TIMES, poses))


def test_a_detour_between_two_paths_is_named_with_its_time_however_long_the_rest_is():
    assert found(led((0.0, 0.9, 0.05))) == []  # in the path of an app
    assert found(led((20.05, 21.0, 0.0049))) == []
    assert found(led((20.05, 21.0, 0.0072))) == ["7.2 mm off the straight line and back at 20.1–21.0 s"]
    assert found(led((250.05, 250.15, 0.02))) == ["20.0 mm off the straight line and back at 250.1 s"]


def test_a_detour_of_the_turn_is_named_also_in_a_press_that_pushes_straight():
    # How far a press leaves the straight way is stated by its app.
    press = app("apply_force", 10.0, 40.0, B, force=(0.0, 0.0, -8.0), off_straight_m=0.006)
    turned = led((20.05, 21.0, 0.006), turns=((20.05, 21.0, math.radians(2.6)),))
    assert found(turned, press) == ["2.6° off the straight line and back at 20.1–21.0 s"]
    assert found(turned) == ["6.0 mm and 2.6° off the straight line and back at 20.1–21.0 s"]
    assert found(led(turns=((20.05, 21.0, math.radians(1.9)),))) == []


def test_a_drift_along_the_straight_way_is_no_detour():
    # The robot goes straight to the next path, and turns on its way there.
    poses = led(turns=((0.0, 400.0, 0.0),))
    share = np.linspace(0.0, 1.0, TIMES.size)
    poses[:, 2] += 0.03 * share
    poses[:, 5], poses[:, 6] = np.sin(0.4 * share), np.cos(0.4 * share)
    assert found(poses) == []


def test_a_robot_without_orientations_has_detours_of_its_position():
    poses = led((20.05, 21.0, 0.0072))
    poses[:, 3:] = np.nan
    assert found(poses) == ["7.2 mm off the straight line and back at 20.1–21.0 s"]


def test_of_many_detours_the_widest_are_named():
    texts = found(led(*((10.0 * k + 0.05, 10.0 * k + 1.0, 0.001 * (5 + k)) for k in range(1, 8))))
    assert [text.split(" ")[0] for text in texts] == ["8.0", "9.0", "10.0", "11.0", "12.0", "2"]
    assert texts[-1] == "2 lesser detours"


def wiggled(rate_hz: float, amplitude_m: float, seconds: float) -> NDArray[np.float64]:
    """Poses of a hand that moves up and down while it rests."""
    poses = led()
    during = (TIMES > 20.05) & (20.0 + seconds > TIMES)
    poses[:, 2] += amplitude_m * np.sin(2.0 * math.pi * rate_hz * TIMES) * during
    return poses


@pytest.mark.parametrize(("rate_hz", "amplitude_m"), [(3.0, 0.003), (1.5, 0.004)])
@pytest.mark.parametrize("pressing", [False, True])
def test_a_wiggle_that_is_no_detour_is_named(rate_hz: float, amplitude_m: float, pressing: bool):
    """A peg was wiggled in by 3 mm to and fro, and the program pressed it straight in without a word."""
    press = app("apply_force", 10.0, 40.0, B, force=(0.0, 0.0, -8.0), off_straight_m=amplitude_m)
    (text,) = found(wiggled(rate_hz, amplitude_m, 2.0), *[press] * pressing)
    seen = re.fullmatch(r"([0-9.]+) mm to and fro at 20\.[0-9]–2[12]\.[0-9] s", text)
    assert seen is not None
    assert float(seen[1]) == pytest.approx(1000 * amplitude_m, rel=0.1)


@pytest.mark.parametrize(
    ("rate_hz", "amplitude_m", "seconds"), [(0.3, 0.003, 8.0), (3.0, 0.0003, 8.0), (3.0, 0.003, 0.7)]
)
def test_a_sway_a_tremor_and_a_short_wiggle_are_a_rest(rate_hz: float, amplitude_m: float, seconds: float):
    assert found(wiggled(rate_hz, amplitude_m, seconds)) == []
