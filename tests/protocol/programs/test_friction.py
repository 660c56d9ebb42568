"""Scripts press along the normal of a surface: what a hand felt of friction along a stroke is left out."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import pytest

from caesura_protocol.messages import App
from caesura_protocol.programs.contact_forces import press_direction, without_friction
from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.programs.franky_script import franky_script
from caesura_protocol.programs.ur_script import ur_script
from caesura_protocol.programs.xarm_script import xarm_script
from harness.programs import as_file, move, press, wiped

FRICTION = 0.5  # of a cloth on a table: a force that leans by 27°


def rubbed(apps: tuple[App, ...]) -> tuple[App, ...]:
    """A stroke along x, where the robot also exerts what friction takes."""
    touch, stroke = apps
    return touch, stroke.model_copy(update={"force": (10.0 * FRICTION, 0.0, -10.0)})


def parts(script: str) -> tuple[list[str], list[float]]:
    """What stands between the numbers of a script, and its numbers; without what is felt with friction."""
    pressed = re.sub(r"'felt_n': .*,\s+|HARDEST_N = .*", "", script)
    found = re.split(r"(-?\d+\.?\d*(?:e-?\d+)?)", pressed)
    return found[::2], list(map(float, found[1::2]))


@pytest.mark.parametrize("write", [franky_script, ur_script, xarm_script])
def test_a_stroke_is_pressed_along_the_normal(write: Callable[[ProgramFile], str]):
    # A wiping leaned by 26° along its strokes: UFACTORY's script was refused, and the others pressed aslant.
    script = write(as_file(rubbed(wiped())))
    said = [line for line in script.splitlines() if "friction takes them along the way" in line]
    assert [line.split("5.0 N of the taught force are left out")[1:] != [] for line in said] == [True]
    assert re.search(r"(felt_n': |HARDEST_N = )11\.18", script)
    (words, numbers), expected = parts(script.replace(f"{said[0]}\n", "")), parts(write(as_file(wiped())))
    assert words == expected[0]
    assert numbers == pytest.approx(expected[1], abs=0.002)


def test_friction_of_a_way_that_comes_back_is_not_known():
    _, stroke = rubbed(wiped())
    assert stroke.path is not None
    path = stroke.path.model_copy(update={"length_m": 3.0 * stroke.path.length_m})
    there_and_back = stroke.model_copy(update={"path": path})
    assert without_friction(there_and_back).force == there_and_back.force


def test_a_surface_is_looked_for_along_the_normal():
    touch, stroke = rubbed(wiped())
    assert press_direction(touch, without_friction(stroke)) == pytest.approx((0.0, 0.0, -1.0))


@pytest.mark.parametrize(
    ("to", "force"),
    [
        ((-0.02, -0.52, 0.165), (0.0, 0.0, -10.0)),  # pushed in
        ((0.01, -0.52, 0.145), (6.0, 0.0, -10.0)),  # pushed in aslant
        ((0.08, -0.52, 0.13), (0.0, 0.0, -10.0)),  # down a slope, as the tool points
        ((0.08, -0.52, 0.19), (-3.0, 0.0, -10.0)),  # against its way: no friction does that
        ((0.08, -0.52, 0.19), (0.0, 3.0, -10.0)),  # across its way
        ((-0.01, -0.52, 0.19), (3.0, 0.0, -10.0)),  # hardly a way
        ((0.08, -0.52, 0.19), (10.0, 0.0, -4.0)),  # a push: no friction takes more than presses
        ((0.08, -0.52, 0.19), (12.0, 0.0, -0.01)),
    ],
)
def test_no_other_part_of_a_force_is_left_out(
    to: tuple[float, float, float], force: tuple[float, float, float]
):
    _, pressed, _ = press()
    path = move(pressed.t0, (-0.02, -0.52, 0.19), to).path
    asked = pressed.model_copy(update={"path": path, "target": to, "force": force})
    kept = without_friction(asked).force
    assert kept is not None
    assert math.dist(kept, force) < 1e-9
