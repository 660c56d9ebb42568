"""Which slides and tilts are ends of a stroke."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from caesura_protocol.messages import ScrewMotion
from caesura_service.program import Moment, Paths, ProgramSegment, task_program
from service.program.segments import ACROSS, OFF, UPRIGHT, drifted, held, program, segment, turned

STILL = {"position_start": (0.1, 0.0, 0.2), "position_end": (0.1, 0.0, 0.2)}  # at the end of `ACROSS`


@pytest.mark.parametrize(
    ("axis", "strokes"),
    [((1.0, 0.0, 0.0), [(1, 2, 3)]), ((0.0, 0.0, -1.0), [(1, 2), (3,)])],
)
def test_a_tilt_in_contact_is_the_end_of_the_stroke_before_it_and_a_turn_about_the_tool_is_not(
    axis: tuple[float, float, float], strokes: list[tuple[int, ...]]
) -> None:
    """A person tilted a peg at the end of a stroke, and the robot that did the same was found to turn."""
    made = program(
        segment("motion", 0.0, 2.0),
        segment("sliding", 2.0, 4.0, **held(9.0), **ACROSS),
        segment("contact", 4.0, 4.3, **held(9.0), **STILL),
        turned(axis, 4.3, 5.0),
        segment("motion", 5.0, 7.0, **OFF),
        at=lambda t: replace(drifted(t, pushed_n=9.0 if 2.0 < t < 5.0 else 0.0), orientation=UPRIGHT),
    )
    pressed = [app for app in made if app.kind == "apply_force"]
    assert [app.segments for app in pressed] == strokes
    assert (pressed[0].t0, pressed[-1].tn) == (2.0, 5.0)
    assert pressed[0].target == pytest.approx((0.11, 0.0, 0.2) if len(strokes) == 1 else (0.1, 0.0, 0.2))


@pytest.mark.parametrize(
    ("torque_nm", "strokes"), [(0.3, [(1, 2, 3)]), (2.0, [(1, 2), (3,)])], ids=["the tip's", "a lever's"]
)
def test_a_tilt_against_more_than_its_force_at_a_hands_breadth_is_no_end_of_a_stroke(
    torque_nm: float, strokes: list[tuple[int, ...]]
) -> None:
    """A stroke does not end at a torque, so that of a lever would be lost. The peg's rim makes one too."""
    tilt = turned((1.0, 0.0, 0.0), 4.3, 5.0)
    screw = ScrewMotion(
        axis=(1.0, 0.0, 0.0), point=(0.1, 0.0, 0.1), angle=0.3, pitch_m=0.0, pitch_sd_m=0.001,
        torque=(-torque_nm, 0.0, 0.0),
    )  # fmt: skip
    made = program(
        segment("motion", 0.0, 2.0),
        segment("sliding", 2.0, 4.0, **held(9.0), **ACROSS),
        segment("contact", 4.0, 4.3, **held(9.0)),
        tilt.model_copy(update={"screw": screw}),
        segment("motion", 5.0, 7.0, **OFF),
        at=lambda t: replace(drifted(t, pushed_n=9.0 if 2.0 < t < 5.0 else 0.0), orientation=UPRIGHT),
    )
    assert [app.segments for app in made if app.kind == "apply_force"] == strokes


@pytest.mark.parametrize(
    ("tip_moves_m", "strokes"), [(0.0, [(1, 2)]), (0.027, [(1,), (2,)])], ids=["a tilt", "a slide"]
)
def test_a_slide_in_which_the_tool_only_turns_about_its_tip_is_the_end_of_the_stroke_before_it(
    tip_moves_m: float, strokes: list[tuple[int, ...]]
) -> None:
    """It moves the flange by 27 mm, far more than the end of a stroke. Named a turn or a slide, it is one."""
    rad, tool_m, start = 0.23, 0.12, np.array([0.1, 0.0, 0.2])

    def tool(angle: float) -> tuple[np.ndarray, tuple[float, float, float, float]]:
        """Its axis, and its orientation, once it is tilted about x."""
        axis = np.array([0.0, -math.sin(angle), -math.cos(angle)])
        return axis, (math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle))

    (upright, _), (tilted, _) = tool(0.0), tool(rad)
    end = start + tool_m * (upright - tilted) + np.array([tip_moves_m, 0.0, 0.0])
    tilt = segment(
        "sliding", 4.0, 5.0, **held(9.0), position_start=tuple(start), position_end=tuple(end)
    ).model_copy(update={"turn": (rad, 0.0, 0.0)})

    def at(t: float) -> Moment:
        share = min(max(t - 4.0, 0.0), 1.0)
        x, y, z, w = tool(share * rad)[1]
        return replace(drifted(t, pushed_n=9.0 if 2.0 < t < 5.0 else 0.0), orientation=(x, y, z, w))

    made = program(
        segment("motion", 0.0, 2.0),
        segment("sliding", 2.0, 4.0, **held(9.0), **ACROSS),
        tilt,
        segment("motion", 5.0, 7.0, **OFF),
        at=at,
    )
    assert [app.segments for app in made if app.kind == "apply_force"] == strokes


def test_a_tilt_after_a_screw_is_an_app_of_its_own() -> None:
    made = program(
        segment("motion", 0.0, 2.0),
        turned((0.0, 0.0, -1.0), 2.0, 4.0),
        turned((1.0, 0.0, 0.0), 4.0, 5.0),
        at=lambda t: replace(drifted(t, pushed_n=0.0 if t < 2.0 else 9.0), orientation=UPRIGHT),
    )
    assert [app.segments for app in made] == [(0,), (1,), (2,)]


SHORT: dict[str, Any] = {"position_start": (0.1, 0.0, 0.2), "position_end": (0.1, 0.013, 0.2)}


LONG: dict[str, Any] = {"position_start": (0.1, 0.0, 0.2), "position_end": (0.1, 0.03, 0.2)}


@pytest.mark.parametrize(("slide", "strokes"), [(SHORT, [(1, 2, 3)]), (LONG, [(1, 2), (3,)])])
def test_a_short_slide_after_a_stroke_is_its_end(
    slide: dict[str, Any], strokes: list[tuple[int, ...]]
) -> None:
    made = program(
        segment("motion", 0.0, 2.0),
        segment("sliding", 2.0, 4.0, **held(9.0), **ACROSS),
        segment("contact", 4.0, 4.6, **held(9.0)),
        segment("sliding", 4.6, 5.2, **held(9.0), **slide),
        segment("motion", 5.2, 7.0, **OFF),
        at=lambda t: drifted(t, pushed_n=9.0 if 2.0 < t < 5.2 else 0.0),
    )
    assert [app.segments for app in made if app.kind == "apply_force"] == strokes


def test_a_short_slide_before_a_stroke_is_its_beginning_with_one_path() -> None:
    """The hand slid on by 13 mm as it touched, and the robot that did the same stood there."""
    slide = {"position_start": (0.0, 0.0, 0.2), "position_end": (0.013, 0.0, 0.2)}
    stroke = {"position_start": (0.013, 0.0, 0.2), "position_end": (0.2, 0.0, 0.2)}
    t = np.linspace(2.0, 6.0, 41)
    poses = np.column_stack(
        [np.interp(t, [2.0, 2.5, 3.0, 6.0], [0.0, 0.013, 0.013, 0.2]), 0.0 * t, 0.0 * t + 0.2]
    )

    def between(t0: float, tn: float) -> tuple[np.ndarray, np.ndarray]:
        inside = (t >= t0 - 1e-9) & (t <= tn + 1e-9)
        return t[inside], poses[inside]

    made = task_program(
        [
            ProgramSegment(0, segment("motion", 0.0, 2.0), 1.0),
            ProgramSegment(1, segment("sliding", 2.0, 2.5, **held(9.0), **slide), 1.0),
            ProgramSegment(2, segment("contact", 2.5, 3.0, **held(9.0)), 1.0),
            ProgramSegment(3, segment("sliding", 3.0, 6.0, **held(9.0), **stroke), 1.0),
        ],
        (),
        lambda t: drifted(t, pushed_n=0.0 if t < 2.0 else 9.0),
        paths=Paths(between),
    )
    (pressed,) = (app for app in made if app.kind == "apply_force")
    assert pressed.path is not None
    assert (pressed.segments, pressed.path.tn) == ((1, 2, 3), 6.0)
    assert pressed.path.start.t == pytest.approx(2.1), "the first observation at which it pushes back"
    assert pressed.target == pytest.approx((0.2, 0.0, 0.2))


@pytest.mark.parametrize(
    ("short_n", "parts"),
    [(9.0, [(0,), (1, 2, 3), (4,)]), (3.5, [(0,), (1,), (3,), (4,)])],
    ids=["one", "light"],
)
def test_a_slide_below_the_minimum_time_before_a_stroke_is_its_beginning(
    short_n: float, parts: list[tuple[int, ...]]
) -> None:
    """A robot slid 15 mm in 0.2 s: the rest before it was a press of its own."""
    still = {"position_start": (-0.015, 0.0, 0.2), "position_end": (-0.015, 0.0, 0.2)}
    slid = {"position_start": (-0.015, 0.0, 0.2), "position_end": (0.0, 0.0, 0.2)}

    def at(t: float) -> Moment:
        pushed_n = 0.0 if not 2.0 < t < 5.0 else short_n if 3.0 < t < 3.2 else 9.0
        return drifted(t, pushed_n=pushed_n)

    made = program(
        segment("motion", 0.0, 2.0, position_end=(-0.015, 0.0, 0.2)),
        segment("contact", 2.0, 3.0, **held(9.0), **still),
        segment("sliding", 3.0, 3.2, **held(short_n), **slid),
        segment("sliding", 3.2, 5.0, **held(9.0), **ACROSS),
        segment("motion", 5.0, 7.0, **OFF),
        at=at,
    )
    assert [app.segments for app in made] == parts


@pytest.mark.parametrize("way_m", [0.013, 0.019])
@pytest.mark.parametrize(
    ("axes", "slide_n", "strokes"),
    [
        ([(1.0, 0.0, 0.0)], 9.0, [(1, 2, 3)]),
        ([(1.0, 0.0, 0.0)], 16.0, [(1, 2), (3,)]),
        ([(0.0, 0.0, 1.0)], 9.0, [(1, 2), (3,)]),
        ([(1.0, 0.0, 0.0), (0.0, 1.0, 0.0)], 9.0, [(1, 2), (3,), (4,)]),
    ],
    ids=["pressed alike", "with another force", "about the tool", "two tilts"],
)
def test_a_short_slide_and_a_tilt_are_one_stroke_without_a_longer_one(
    way_m: float, axes: list[tuple[float, float, float]], slide_n: float, strokes: list[tuple[int, ...]]
) -> None:
    """A peg was slid by 40 mm and tilted, and the last 20 mm of the robot's slide were a segment."""
    ends = 4.3 + 0.7 * len(axes)
    short = {"position_start": (0.1 - way_m, 0.0, 0.2), "position_end": (0.1, 0.0, 0.2)}

    def at(t: float) -> Moment:
        push = slide_n if 3.0 < t < 4.3 else 9.0 if 4.3 < t < ends else 0.0
        place = (0.1 - way_m * min(max(4.0 - t, 0.0), 1.0), 0.0, 0.2)
        return replace(drifted(t, pushed_n=push), position=place, orientation=UPRIGHT)

    made = program(
        segment("motion", 0.0, 3.0),
        segment("sliding", 3.0, 4.0, **held(slide_n), **short),
        segment("contact", 4.0, 4.3, **held(slide_n)),
        *(turned(axis, 4.3 + 0.7 * k, 5.0 + 0.7 * k) for k, axis in enumerate(axes)),
        segment("motion", ends, ends + 2.0, **OFF),
        at=at,
    )
    assert [app.segments for app in made if app.kind == "apply_force"] == strokes
