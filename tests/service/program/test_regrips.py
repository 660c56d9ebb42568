"""Fingers that close in stages, and a grip that changes around what is held."""

from __future__ import annotations

from dataclasses import replace

import pytest

from caesura_protocol.messages import Segment
from caesura_service.program import Context, GripperAction, Moment, MomentAt, ProgramSegment, with_regrips
from service.program.segments import moment_at, segment

HELD = {"load_kg": 0.3, "load_sd_kg": 0.01}
NOTHING = {"load_kg": 0.01, "load_sd_kg": 0.01}
WEIGHT_N = 3.0


def read(*grips: GripperAction, steps: tuple[Segment, ...] = (), at: MomentAt = moment_at) -> list[str]:
    parts = [ProgramSegment(index, one, one.probability) for index, one in enumerate(steps)]
    return [one.kind for one in with_regrips(parts, Context(grips, at))]


def standing(t: float) -> Moment:
    return replace(moment_at(t), position=(0.0, 0.0, 0.1))


CLOSES_TWICE = (
    GripperAction(1.0, "grasp", 0.05),
    GripperAction(3.0, "grasp", 0.03),
    GripperAction(6.0, "release", 0.08),
)


def test_fingers_that_close_twice_at_one_place_grasp_once() -> None:
    """A grasp in two stages was two grasps, and its program could not be run."""
    assert read(*CLOSES_TWICE, at=standing) == ["close", "grasp", "release"]
    assert read(*CLOSES_TWICE) == ["grasp", "grasp", "release"]


def test_a_turn_in_place_may_carry_what_is_held() -> None:
    def turning(t: float) -> Moment:
        return replace(standing(t), orientation=(0.0, 0.0, 0.0, 1.0) if t < 2.0 else (0.0, 0.0, 0.1, 0.995))

    assert read(*CLOSES_TWICE, at=turning) == ["grasp", "grasp", "release"]


@pytest.mark.parametrize(
    ("before", "after", "first"),
    [(NOTHING, HELD, "close"), (HELD, HELD, "grasp"), (NOTHING, NOTHING, "grasp"), ({}, {}, "grasp")],
    ids=["weighs only then", "weighs before", "too light", "not weighed"],
)
def test_a_closing_before_anything_weighs_grasps_nothing(
    before: dict[str, float], after: dict[str, float], first: str
) -> None:
    """Fingers that were set to 50 mm on their way grasped twice."""
    steps = segment("transport", 1.0, 3.0, **before), segment("transport", 3.0, 6.0, **after)
    assert read(*CLOSES_TWICE, steps=steps) == [first, "grasp", "release"]


@pytest.mark.parametrize(("down_n", "first"), [(-3.0, "grasp"), (3.0, "close")])
def test_a_lift_that_was_found_as_a_contact_has_a_weight(down_n: float, first: str) -> None:
    """A part was lifted, and its grip tightened in the air: the robot pulled with 8 N on nothing."""
    steps = (
        segment("contact", 1.2, 1.5, force_held=(0.0, 0.0, down_n)),
        segment("sliding", 1.5, 2.0, force_held=(0.0, 0.0, down_n)),
        segment("hold", 2.0, 5.0, **HELD),
    )
    assert read(*CLOSES_TWICE, steps=steps) == [first, "grasp", "release"]


def eased(to_m: float, *, hangs_n: float, load: dict[str, float]) -> list[str]:
    """A load is carried, squeezed, eased at 4 s, and what is left of its weight is moved on."""

    def at(t: float) -> Moment:
        down = 0.0 if t < 1.0 else WEIGHT_N if t < 4.0 else hangs_n
        return replace(moment_at(t), force=(0.0, 0.0, -down))

    return read(
        GripperAction(1.0, "grasp", 0.03),
        GripperAction(3.0, "grasp", 0.022),
        GripperAction(4.0, "release", to_m),
        GripperAction(8.0, "open", 0.08),
        steps=(
            segment("motion", 0.0, 1.0),
            segment("transport", 1.0, 4.0, **load),
            segment("steady", 4.0, 4.2),
            segment("motion", 4.2, 8.0),
        ),
        at=at,
    )


def test_fingers_that_open_no_wider_than_they_grasped_keep_what_still_hangs() -> None:
    """A pipette was let go in the air at its first drop, and then nothing was carried."""
    assert eased(0.03, hangs_n=WEIGHT_N, load=HELD) == ["grasp", "grasp", "grasp", "open"]


@pytest.mark.parametrize(
    ("to_m", "hangs_n", "load"),
    [(0.04, WEIGHT_N, HELD), (0.03, 0.4 * WEIGHT_N, HELD), (0.03, WEIGHT_N, {}), (0.03, -WEIGHT_N, HELD)],
    ids=["wider", "fallen", "not weighed", "pushed back"],
)
def test_else_fingers_that_open_let_go(to_m: float, hangs_n: float, load: dict[str, float]) -> None:
    assert eased(to_m, hangs_n=hangs_n, load=load) == ["grasp", "grasp", "release", "open"]


def test_a_grip_may_be_squeezed_and_eased_many_times() -> None:
    grips = [GripperAction(1.0, "grasp", 0.03)]
    for t in range(3, 8, 2):
        grips += [GripperAction(float(t), "grasp", 0.022), GripperAction(t + 1.0, "release", 0.03)]
    carry = segment("transport", 1.0, 3.0, **HELD)
    rest = segment("hold", 3.0, 9.0)

    def at(t: float) -> Moment:
        return replace(moment_at(t), force=(0.0, 0.0, -WEIGHT_N if t > 1.0 else 0.0))

    assert read(*grips, steps=(carry, rest), at=at) == ["grasp"] * 7


def test_a_closed_flag_has_no_width_that_could_be_eased() -> None:
    load = segment("transport", 1.0, 4.0, **HELD)
    assert read(GripperAction(1.0, "grasp", None), GripperAction(4.0, "release", None), steps=(load,)) == [
        "grasp",
        "release",
    ]
