"""What belongs to a rest between a movement and what is pressed after it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from caesura_protocol.programs.checks.preconditions import precondition_findings
from caesura_service.program import GripperAction, Moment, Paths, ProgramSegment, task_program
from service.program.segments import GRASP, RELEASE, drifted, held, kinds, moment_at, program, segment


def test_a_press_that_follows_a_rest_was_touched_by_the_movement_before_it() -> None:
    """The program pressed without a contact, so its own check refused it."""
    made = program(
        segment("motion", 0.0, 2.0), segment("steady", 2.0, 2.6), segment("contact", 2.6, 4.0, **held(9.0))
    )
    assert kinds(made) == ["move_to_contact", "apply_force"]


def test_a_press_after_a_rest_in_which_the_fingers_move_was_touched_after_they_moved() -> None:
    """No app made its contact, so the program's own check refused the press."""
    made = program(
        segment("motion", 0.0, 2.0),
        segment("steady", 2.0, 4.0),
        segment("contact", 4.0, 6.0, **held(9.0)),
        grips=(GripperAction(2.8, "open", 0.08),),
        at=lambda t: drifted(t, pushed_n=9.0 if t > 4.0 else 0.0),
    )
    assert kinds(made) == ["cartesian_motion", "gripper_move", "move_to_contact", "apply_force"]
    assert made[2].target == pytest.approx((0.0, 0.0, 0.405))
    assert made[1].tn < made[2].t0 < made[2].tn <= made[3].t0
    assert not [one for one in precondition_findings(made) if "without a contact" in one.reason]


def test_the_path_to_a_contact_ends_before_the_rest_that_follows() -> None:
    """The rest was a pause after the contact, and its three seconds were in the path of 2 s too."""

    def poses(t0: float, tn: float) -> Any:
        t = np.linspace(t0, tn, 60)
        return t, np.column_stack([0.0 * t, 0.0 * t, 0.1 * np.minimum(t, 2.0)])

    parts = (
        segment("motion", 0.0, 2.0),
        segment("steady", 2.0, 5.0),
        segment("contact", 5.0, 7.0, **held(9.0)),
    )
    steps = [ProgramSegment(i, one, 1.0) for i, one in enumerate(parts)]
    touching, pressing = task_program(steps, (), moment_at, paths=Paths(poses))
    assert touching.path is not None
    assert (touching.path.tn, touching.tn, pressing.t0) == (2.0, 2.0, 5.0)


@pytest.mark.parametrize(("released_s", "becomes"), [(3.0, "cartesian_motion"), (4.9, "move_to_contact")])
def test_fingers_that_open_in_a_rest_open_before_what_is_pressed_after_it(
    released_s: float, becomes: str
) -> None:
    """The movement went to where the press began 2 s later, and the fingers opened there."""
    made = program(
        segment("motion", 0.0, 2.0),
        segment("steady", 2.0, 5.0),
        segment("contact", 5.0, 7.0, **held(9.0)),
        grips=(replace(RELEASE, t=released_s),),
    )
    assert made[0].kind == becomes
    assert "gripper_move" in kinds(made)
    if becomes == "cartesian_motion":
        assert kinds(made)[1:] == ["gripper_move", "move_to_contact", "apply_force"]
        assert made[0].target == pytest.approx(moment_at(2.0).position)


def test_what_is_gripped_while_it_is_touched_before_a_turn_was_touched_by_the_movement_before_it() -> None:
    turn = segment("sliding", 2.4, 4.0, **held(9.0)).model_copy(update={"kind": "turning"})
    touched = segment("contact", 2.0, 2.4, **held(9.0))
    made = program(segment("motion", 0.0, 2.0), touched, turn, grips=(replace(GRASP, t=2.05),))
    assert kinds(made) == ["move_to_contact", "grasp", "apply_force"]


def test_a_turn_in_the_second_of_two_rests_before_a_press_comes_before_the_contact() -> None:
    """Between the rests lies a movement that is too short for an app."""

    def poses(t0: float, tn: float) -> Any:
        t = np.linspace(t0, tn, 60)
        half = 0.5 * np.clip((t - 3.0) / 0.5, 0.0, 1.0)
        zero = np.zeros_like(t)
        return t, np.column_stack([zero, zero, zero + 0.2, zero, zero, np.sin(half), np.cos(half)])

    made = task_program(
        [
            ProgramSegment(i, one, 1.0)
            for i, one in enumerate(
                (
                    segment("motion", 0.0, 2.0),
                    segment("steady", 2.0, 2.6),
                    segment("motion", 2.6, 2.8),
                    segment("steady", 2.8, 4.0),
                    segment("contact", 4.0, 5.0, **held(9.0)),
                )
            )
        ],
        (),
        moment_at,
        paths=Paths(poses),
    )
    assert kinds(made) == ["cartesian_motion", "cartesian_motion", "apply_force"]


def pushed_from_2_s(t: float) -> Moment:
    return drifted(t, pushed_n=9.0 if t > 2.0 else 0.0)


@pytest.mark.parametrize("aside_m", [0.0, 0.0043, 0.0073])
def test_a_press_has_a_path_or_states_how_far_it_was_off_the_straight_way(aside_m: float) -> None:
    """Nothing of a program showed that a press wound: a peg that searched its hole was pushed straight."""

    def poses(t0: float, tn: float) -> Any:
        t = np.linspace(t0, tn, 60)
        aside = aside_m * np.sin(np.pi * np.clip((t - 2.0) / 2.0, 0.0, 1.0))
        return t, np.column_stack([aside, 0.0 * t, 0.4 - 0.005 * np.clip(t - 2.0, 0.0, 2.0)])

    parts = (segment("motion", 0.0, 2.0), segment("contact", 2.0, 4.0, **held(9.0)))
    steps = [ProgramSegment(i, one, 1.0) for i, one in enumerate(parts)]
    for settled, known in ((np.inf, True), (3.0, False)):
        paths = Paths(poses, settled_until=settled)
        press = task_program(steps, (), pushed_from_2_s, paths=paths)[-1]
        assert press.kind == "apply_force"
        assert (press.path is not None) == (known and aside_m > 0.005)
        straight = known and press.path is None
        assert press.off_straight_m == (pytest.approx(aside_m, abs=5e-4) if straight else None)
