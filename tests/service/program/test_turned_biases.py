"""Forces that turn with the flange as a bias of the sensor does are named, and contacts are not."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import pytest
from scipy.spatial.transform import Rotation

from caesura_service.program import Moment, MomentAt, turned_biases_note
from service.program.segments import ACROSS, GRASP, held, program, segment

QUARTER = math.pi / 2
Angle = Callable[[float], float]


def turns(t: float) -> float:
    """The angle [rad] of a flange that turns from 3 to 5 s, and back from 7 to 9 s."""
    share = min(max((t - 3.0) / 2.0, 0.0), 1.0) - min(max((t - 7.0) / 2.0, 0.0), 1.0)
    return QUARTER * share


def in_flange(newton: float, angle: Angle = turns) -> MomentAt:
    """A bias along the x axis of the flange, tared at the start, and read in the axes of the base."""

    def at(t: float) -> Moment:
        turn = Rotation.from_rotvec((0.0, angle(t), 0.0))
        x, y, z = turn.apply((newton, 0.0, 0.0)).tolist()
        return Moment((0.0, 0.0, 0.2), tuple(turn.as_quat().tolist()), None, None, (x - newton, y, z))

    return at


def touching(newton: float, angle: Angle = turns, *, t0: float = 5.0, tn: float = 7.0) -> MomentAt:
    """A contact from one time [s] to another, whose force is the same in the axes of the flange."""

    def at(t: float) -> Moment:
        turn = Rotation.from_rotvec((0.0, angle(t), 0.0))
        x, y, z = turn.apply((newton if t0 <= t < tn else 0.0, 0.0, 0.0)).tolist()
        return Moment((0.0, 0.0, 0.2), tuple(turn.as_quat().tolist()), None, None, (x, y, z))

    return at


def note(at: MomentAt, kind: str = "contact", *, t0: float = 5.0, tn: float = 7.0) -> str | None:
    force = at(0.5 * (t0 + tn)).force
    load = {"load_kg": 0.8, "load_sd_kg": 0.02} if kind == "hold" else held(0.0) | {"force_held": force}
    apps = program(
        segment("motion", 0.0, t0, **ACROSS),
        segment(kind, t0, tn, **load),
        segment("motion", tn, 12.0, **ACROSS),
        at=at,
        grips=(GRASP,) if kind == "hold" else (),
    )
    return turned_biases_note(apps, at, 0.0, 12.0)


@pytest.mark.parametrize("kind", ["contact", "sliding"])
def test_a_bias_that_turned_with_the_flange_is_named_with_its_size_and_time(kind: str) -> None:
    """A bias of 8 N was a press of 11 N in the air as the flange turned by 90°, without a finding."""
    found = note(in_flange(8.0), kind)
    assert found is not None
    assert found.startswith("Forces that turn with the flange, as a bias of the sensor does: ")
    (newton,) = re.findall(r"(\d+\.\d) N at 5\.0–7\.0 s", found)
    assert 6.0 < float(newton) < 11.4  # the air beside it has a part of it


@pytest.mark.parametrize(
    ("newton", "angle", "t0", "tn"),
    [
        (8.0, turns, 5.0, 7.0),  # the flange turned before it touched
        (8.0, turns, 2.0, 6.0),  # it turns in contact, as along a round surface
        (20.0, turns, 3.2, 4.8),
        (8.0, lambda t: 0.0, 5.0, 7.0),
        (8.0, lambda t: 0.2 * t, 5.0, 7.0),  # it never stops turning
    ],
)
def test_a_contact_begins_and_ends_while_the_flange_does_not_turn_as_much(
    newton: float, angle: Angle, t0: float, tn: float
) -> None:
    assert note(touching(newton, angle, t0=t0, tn=tn), t0=t0, tn=tn) is None


def test_a_force_without_an_orientation_may_be_anything() -> None:
    turning = in_flange(8.0)

    def at(t: float) -> Moment:
        seen = turning(t)
        return Moment(seen.position, None, None, None, seen.force)

    assert note(at) is None
