"""What gives way, such as a drawer or a box, is moved along its path, not pressed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from caesura_protocol.app_contacts import is_resisted
from caesura_protocol.messages import App, Segment, Vector
from caesura_protocol.programs.app_time_shifts import may_retime
from caesura_protocol.programs.checks.preconditions import precondition_findings
from caesura_service.program import (
    GripperAction,
    Moment,
    Paths,
    ProgramSegment,
    parts_in_no_app_note,
    task_program,
)
from service.program.segments import GRASP, RELEASE, kinds, moment_at, segment

PULL_N = (0.0, 10.0, 0.0)


def taught(
    *contacts: Segment,
    way_m: float = 0.14,
    begun_s: float = 3.0,
    gripped_s: float = 2.6,
    force: Vector = PULL_N,
    corrected: bool = False,
) -> tuple[App, ...]:
    """Move to a handle, grip it in a rest from 2 to 3 s, and pull against a force from `begun_s` to 5 s."""

    def at(t: float) -> Moment:
        y = -way_m * min(max((t - begun_s) / (5.0 - begun_s), 0.0), 1.0)
        felt = force if 3.0 < t < 6.0 else (0.0, 0.0, 0.0)
        return replace(moment_at(min(t, 2.0)), position=(0.0, y, 0.1 * min(t, 2.0)), force=felt)

    def poses(t0: float, tn: float) -> tuple[Any, Any]:
        times = np.arange(t0, tn + 1e-9, 0.1)
        return times, np.array([at(t).position for t in times])

    ends = {"position_start": at(begun_s).position, "position_end": at(5.0).position}
    parts = (
        segment("motion", 0.0, 2.0),
        segment("steady", 2.0, 3.0, **dict.fromkeys(("position_start", "position_end"), at(2.0).position)),
        *(one for one in contacts if one.tn <= begun_s),
        segment("sliding", begun_s, 5.0, force_held=force, corrected=corrected, **ends),
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
    assert pull.force_taught == pytest.approx((0.0, -10.0, 0.0))


def test_the_rests_in_contact_beside_a_drag_belong_to_what_is_carried() -> None:
    still = {"force_held": PULL_N, "position_start": (0.0, 0.0, 0.2), "position_end": (0.0, 0.0, 0.2)}
    there = still | dict.fromkeys(("position_start", "position_end"), (0.0, -0.14, 0.2))
    made = taught(segment("contact", 3.0, 3.5, **still), segment("contact", 5.0, 6.0, **there), begun_s=3.5)
    assert kinds(made) == ["cartesian_motion", "grasp", "transport", "hold"]
    assert made[2].segments == (2, 3)
    assert made[2].t0 == 3.0


@pytest.mark.parametrize(
    "change",
    [{"way_m": 0.03}, {"gripped_s": 3.8}, {"gripped_s": 9.0, "way_m": 0.03}],
    ids=["it gives way by 30 mm", "the fingers close meanwhile", "nothing is held, by 30 mm"],
)
def test_other_contacts_stay_contacts(change: dict[str, float]) -> None:
    made = taught(**change)
    assert "transport" not in kinds(made)
    assert not any(map(is_resisted, made))


def evenly(share: float) -> float:
    return share


def smoothly(share: float) -> float:
    """Rise from 0 to 1 at minimum jerk, as a hand does."""
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


def sprung(
    most_n: float, way_m: float = 0.1, out_s: float = 2.0, law: Callable[[float], float] = evenly
) -> tuple[App, ...]:
    """Pull a gripped handle against a spring from 2 s on, hold it for 1 s, and let it back as fast.

    The fingers let go 1.5 s after that.
    """
    held, left, back = np.cumsum([2.0 + out_s, 1.0, out_s]).tolist()

    def at(t: float) -> Moment:
        share = law(float(np.interp(t, [2.0, held, left, back], [0.0, 1.0, 1.0, 0.0])))
        return replace(moment_at(0.0), position=(0.0, -way_m * share, 0.2), force=(0.0, most_n * share, 0.0))

    def part(kind: str, t0: float, tn: float, **fields: Any) -> Segment:
        ends = {"position_start": at(t0).position, "position_end": at(tn).position}
        return segment(kind, t0, tn, **ends, **fields)

    def poses(t0: float, tn: float) -> tuple[Any, Any]:
        times = np.arange(t0, tn + 1e-9, 0.1)
        return times, np.array([at(t).position for t in times])

    load = {"load_kg": 0.0, "load_sd_kg": 0.05}
    parts = (
        part("steady", 0.0, 1.0),
        part("hold", 1.0, 2.0, **load),
        part("transport", 2.0, held, **load, force_end=(0.0, most_n, 0.0)),
        part("contact", held, left, force_held=(0.0, most_n, 0.0)),
        part("transport", left, back, **load),
        part("hold", back, back + 1.5, **load),
    )
    steps = [ProgramSegment(index, one, 1.0) for index, one in enumerate(parts)]
    return task_program(steps, (GRASP, replace(RELEASE, t=back + 1.5)), at, paths=Paths(poses))


def test_a_handle_against_a_spring_is_carried_on_both_ways() -> None:
    """The force that faded on the way back counted as a touch, and that way was in no app."""
    made = sprung(20.0)
    assert kinds(made) == ["grasp", "hold", "transport", "hold", "transport", "hold", "gripper_move"]
    _, _, out, _, back, _, _ = made
    assert out.path is not None
    assert back.path is not None
    assert out.path.length_m == pytest.approx(0.1, abs=0.01)
    assert back.path.length_m == pytest.approx(0.1, abs=0.01)
    assert out.force_taught == pytest.approx((0.0, -20.0, 0.0), abs=1.0)
    assert [is_resisted(one) for one in made] == [one is out for one in made]


@pytest.mark.parametrize("most_n", [8.0, 10.0, 20.0])
def test_a_short_smooth_way_back_leaves_no_force_behind(most_n: float) -> None:
    """The median of the way counted as the bias, so the robot pressed in the rest after it."""
    made = sprung(most_n, way_m=0.04, out_s=1.2, law=smoothly)
    *_, held, _, rest, release = made
    assert [one.kind for one in made if one.t0 >= held.tn] == ["transport", "hold", "gripper_move"]
    assert (rest.kind, release.force_taught) == ("hold", None)
    assert held.force == pytest.approx((0.0, -most_n, 0.0), abs=1.0)


@pytest.mark.parametrize(("most_n", "way_m"), [(20.0, 0.04), (2.0, 0.1)])
def test_a_short_way_or_a_weak_spring_is_no_resisted_movement(most_n: float, way_m: float) -> None:
    assert not any(map(is_resisted, sprung(most_n, way_m)))


def pushed(*contacts: Segment, **changes: Any) -> list[App]:
    """What is pushed without a grip; the fingers close long after it."""
    return [one for one in taught(*contacts, gripped_s=9.0, **changes) if one.kind != "grasp"]


def test_a_box_that_is_pushed_is_moved_along_its_path() -> None:
    """It was a press 140 mm deep, which the check refuses, after a movement that searched for a contact."""
    way, push = pushed()
    assert (way.kind, push.kind) == ("cartesian_motion", "cartesian_motion")
    assert push.path is not None
    assert push.path.length_m == pytest.approx(0.14, abs=0.01)
    assert push.target == pytest.approx((0.0, -0.14, 0.2))
    assert push.force is None
    assert push.force_taught == pytest.approx((0.0, -10.0, 0.0))
    assert is_resisted(push)
    assert not is_resisted(way)


@pytest.mark.parametrize(("across_n", "is_pushed"), [(0.0, True), (4.5, True), (5.5, False), (10.0, False)])
def test_a_tool_that_follows_a_surface_presses_on_it(across_n: float, is_pushed: bool) -> None:
    """A surface that a tool follows resists it by friction, and pushes back across the way."""
    assert any(map(is_resisted, pushed(force=(across_n, 10.0, 0.0)))) == is_pushed


STILL: dict[str, Any] = {"force_held": PULL_N, "position_start": (0, 0, 0.2), "position_end": (0, 0, 0.2)}
THERE = STILL | dict.fromkeys(("position_start", "position_end"), (0.0, -0.14, 0.2))


@pytest.mark.parametrize(("rest_s", "is_press"), [(0.5, False), (1.0, True)])
def test_a_short_rest_before_a_push_is_its_beginning(rest_s: float, is_press: bool) -> None:
    made = pushed(segment("contact", 3.0, 3.0 + rest_s, **STILL), begun_s=3.0 + rest_s)
    touch = ["move_to_contact", "apply_force"] if is_press else ["cartesian_motion"]
    assert kinds(made) == [*touch, "cartesian_motion"]
    assert made[-1].segments == ((3,) if is_press else (2, 3))


def test_a_press_follows_a_push_at_once() -> None:
    """A drawer that is pushed shut is pressed at its end: the robot needs no search for that contact."""
    hard = THERE | {"force_held": (0.0, 25.0, 0.0)}
    made = pushed(segment("contact", 5.0, 6.0, **hard))
    assert kinds(made) == ["cartesian_motion", "cartesian_motion", "apply_force"]
    assert made[2].force == pytest.approx((0.0, -25.0, 0.0))
    assert precondition_findings(made) == []


@pytest.mark.parametrize(("newton", "is_lost"), [(10.0, False), (40.0, True)])
def test_only_a_harder_contact_beside_a_push_is_one_of_its_own(newton: float, is_lost: bool) -> None:
    hit = segment("contact", 5.0, 5.2, **(THERE | {"force_held": (0.0, newton, 0.0)}))
    way, push = pushed(hit)
    steps = segment("motion", 0.0, 2.0), segment("sliding", 2.0, 5.0, force_held=PULL_N), hit
    apps = way.model_copy(update={"segments": (0,)}), push.model_copy(update={"segments": (1,)})
    found = parts_in_no_app_note(steps, apps, lambda t: Moment((0.0, -0.14, 0.2), None, None, None))
    assert (f"a contact of {newton} N at 5.0–5.2 s" in (found or "")) == is_lost


def test_what_is_pushed_keeps_its_taught_speed() -> None:
    """A box that is pushed faster may slide on."""
    way, push = pushed()
    assert [may_retime(one) for one in (way, push)] == [way.path is not None, False]


@pytest.mark.parametrize("corrected", [False, True])
def test_a_kind_that_an_operator_has_set_stays(corrected: bool) -> None:
    assert ("transport" in kinds(taught(corrected=corrected))) == (not corrected)
    assert any(map(is_resisted, pushed(corrected=corrected))) == (not corrected)
