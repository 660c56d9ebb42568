"""Limits of a program that follow from its robot."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from caesura_protocol.programs.default_safety import cell_safety, safety_for
from caesura_protocol.programs.document import document_of_apps, on_robot
from caesura_protocol.programs.safety import DEFAULT
from harness.programs import pick_and_place


@pytest.mark.parametrize("robot", [None, "panda", "an-arm-that-is-not-here"])
def test_the_limits_of_a_panda_or_of_no_known_robot_are_the_default(robot: str | None) -> None:
    assert safety_for(robot) == DEFAULT


@pytest.mark.parametrize(
    ("robot", "load_kg", "high"),
    [
        ("ur5e", 5.0, (0.75, 0.75, 0.9)),
        ("ur10e", 12.5, (1.14, 1.14, 1.37)),
        ("xarm7", 3.5, (0.75, 0.75, 0.9)),  # a shorter arm: the check of reach is narrower
    ],
)
def test_a_robot_has_its_payload_and_a_box_of_its_reach(
    robot: str, load_kg: float, high: tuple[float, float, float]
) -> None:
    limits = safety_for(robot)
    assert (limits.load_kg, limits.workspace_high) == (load_kg, high)
    assert limits.workspace_low == (-high[0], -high[1], -0.05)
    others = {"load_kg", "workspace_low", "workspace_high"}
    assert limits.model_dump(exclude=others) == DEFAULT.model_dump(exclude=others)


def test_the_file_of_a_cell_goes_before_the_robot(tmp_path: Path) -> None:
    path = tmp_path / "cell.json"
    path.write_text(json.dumps({"load_kg": 1.5, "force_n": 10.0}), encoding="utf-8")
    limits = cell_safety(path, "ur10e")
    assert (limits.load_kg, limits.force_n) == (1.5, 10.0)
    assert limits.workspace_high == (1.14, 1.14, 1.37)


def test_a_program_for_another_robot_gets_its_limits_but_keeps_those_of_its_cell() -> None:
    taught = on_robot(document_of_apps(pick_and_place(), "taught"), "panda")
    assert taught.safety == DEFAULT
    there = on_robot(taught, "ur10e", retarget=True)
    assert there.safety == safety_for("ur10e")
    narrow = taught.model_copy(update={"safety": DEFAULT.model_copy(update={"load_kg": 1.0})})
    moved = on_robot(narrow, "ur10e", retarget=True)
    assert (moved.safety.load_kg, moved.safety.workspace_high) == (1.0, (1.14, 1.14, 1.37))
