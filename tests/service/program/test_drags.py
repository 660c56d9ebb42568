"""A held object that gives way, such as a drawer, is carried along its path, not pressed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from caesura_protocol.messages import App, Segment
from caesura_service.program import GripperAction, Moment, Paths, ProgramSegment, task_program
from service.program.segments import GRASP, kinds, moment_at, segment

PULL_N = (0.0, 10.0, 0.0)


def taught(
    *contacts: Segment, way_m: float = 0.14, begun_s: float = 3.0, gripped_s: float = 2.6
) -> tuple[App, ...]:
    """Move to a handle, grip it in a rest from 2 to 3 s, and pull against 10 N from `begun_s` to 5 s."""

    def at(t: float) -> Moment:
        y = -way_m * min(max((t - begun_s) / (5.0 - begun_s), 0.0), 1.0)
        force = PULL_N if 3.0 < t < 6.0 else (0.0, 0.0, 0.0)
        return replace(moment_at(min(t, 2.0)), position=(0.0, y, 0.1 * min(t, 2.0)), force=force)

    def poses(t0: float, tn: float) -> tuple[Any, Any]:
        times = np.arange(t0, tn + 1e-9, 0.1)
        return times, np.array([at(t).position for t in times])

    ends = {"position_start": at(begun_s).position, "position_end": at(5.0).position}
    parts = (
        segment("motion", 0.0, 2.0),
        segment("steady", 2.0, 3.0, **dict.fromkeys(("position_start", "position_end"), at(2.0).position)),
        *(one for one in contacts if one.tn <= begun_s),
        segment("sliding", begun_s, 5.0, force_held=PULL_N, **ends),
        *(one for one in contacts if one.t0 >= 5.0),
    )
    steps = [ProgramSegment(index, one, 1.0) for index, one in enumerate(parts)]
    grips = (GripperAction(gripped_s, GRASP.kind, GRASP.width),)
    return task_program(steps, grips, at, paths=Paths(poses))


@pytest.mark.parametrize("gripped_s", [2.2, 2.6, 2.9])
def test_a_drawer_that_is_gripped_and_pulled_is_carried_along_its_path(gripped_s: float) -> None:
    """It was a press 142 mm deep, with a movement to its handle that searched for a contact."""
    made = taught(gripped_s=gripped_s)
    assert kinds(made) == ["cartesian_motion", "grasp", "transport"]
    pull = made[2]
    assert pull.path is not None
    assert pull.path.length_m == pytest.approx(0.14, abs=0.01)
    assert pull.target == pytest.approx((0.0, -0.14, 0.2))
    assert pull.load_kg == pytest.approx(0.0)


def test_the_rests_in_contact_beside_a_drag_belong_to_what_is_carried() -> None:
    still = {"force_held": PULL_N, "position_start": (0.0, 0.0, 0.2), "position_end": (0.0, 0.0, 0.2)}
    there = still | dict.fromkeys(("position_start", "position_end"), (0.0, -0.14, 0.2))
    made = taught(segment("contact", 3.0, 3.5, **still), segment("contact", 5.0, 6.0, **there), begun_s=3.5)
    assert kinds(made) == ["cartesian_motion", "grasp", "transport", "hold"]
    assert made[2].segments == (2, 3)
    assert made[2].t0 == 3.0


@pytest.mark.parametrize(
    "change",
    [{"way_m": 0.03}, {"gripped_s": 3.8}, {"gripped_s": 7.0}],
    ids=["it gives way by 30 mm", "the fingers close meanwhile", "nothing is held"],
)
def test_other_contacts_stay_contacts(change: dict[str, float]) -> None:
    assert "transport" not in kinds(taught(**change))


@pytest.mark.parametrize("corrected", [False, True])
def test_a_kind_that_an_operator_has_set_stays(corrected: bool) -> None:
    pull = segment("sliding", 0.0, 2.0, force_held=PULL_N, position_end=(0.0, -0.2, 0.0), corrected=corrected)
    steps = [ProgramSegment(0, pull, 1.0)]
    made = task_program(steps, (GripperAction(-1.0, "grasp", 0.05),), moment_at)
    assert ("transport" in kinds(made)) == (not corrected)
