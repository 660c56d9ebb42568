"""What the sensor makes up, and what a contact adds to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from caesura_service.program import GripperAction, Moment
from service.program.segments import ACROSS, OFF, drifted, forces_of, held, program, segment


def test_a_press_is_what_it_adds_to_the_force_that_was_there_before() -> None:
    apps = program(segment("motion", 0.0, 2.0), segment("contact", 2.0, 3.0, **held(8.0)), at=drifted)
    assert apps[1].force_taught == pytest.approx((0.0, 0.0, -8.0))


def test_presses_that_follow_each_other_are_all_measured_from_before_the_first() -> None:
    apps = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 3.0, **held(18.0)),
        segment("sliding", 3.0, 4.5, **held(9.0), **ACROSS),
        at=lambda t: drifted(t, pushed_n=0.0 if t < 2.0 else 18.0 if t < 3.0 else 9.0),
    )
    assert apps[1].force_taught == pytest.approx((0.0, 0.0, -9.0))
    assert forces_of(apps[1]) == pytest.approx([9.0, 18.0])


def test_what_is_touched_at_the_end_of_an_approach_is_no_bias() -> None:
    """A hand pushed a pump in for half a second of the movement towards it: its force became the bias."""

    def pushed(t: float) -> Moment:
        return drifted(t, pushed_n=8.0 if 1.5 <= t < 4.0 else 0.0)

    apps = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 4.0, **held(8.0)),
        segment("motion", 4.0, 6.0),
        at=pushed,
    )
    assert apps[1].force_taught == pytest.approx((0.0, 0.0, -8.0), abs=0.3)


def test_a_knock_at_the_end_of_what_follows_a_contact_is_no_bias() -> None:
    """Each of some knocks in a row became the bias of the one before, so that its approach was no path."""

    def knocked(t: float) -> Moment:
        return drifted(t, pushed_n=30.0 if 3.1 <= t < 3.5 else 8.0 if 2.0 <= t < 2.5 else 0.0)

    apps = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 2.5, **held(8.0)),
        segment("motion", 2.5, 3.2),
        segment("contact", 3.2, 3.5, **held(30.0)),
        at=knocked,
    )
    assert apps[1].force_taught == pytest.approx((0.0, 0.0, -8.0), abs=0.3)


def test_the_bias_of_a_sensor_is_read_on_both_sides_of_a_contact() -> None:
    """It wandered by 3 N over a stroke, whose force was said to be 1.5 N too large."""

    def wandering(t: float) -> Moment:
        pushed_n = 10.0 if 2.0 < t < 6.0 else 0.0
        return drifted(t, pushed_n=pushed_n + min(max(0.75 * (t - 2.0), 0.0), 3.0))

    stroke, rest = (
        segment("sliding", 2.0, 5.0, **held(11.1), **ACROSS),
        segment("contact", 5.0, 6.0, **held(12.6)),
    )
    off = segment("motion", 6.0, 8.0, **OFF)
    apps = program(segment("motion", 0.0, 2.0), stroke, rest, off, at=wandering)
    assert forces_of(apps[1]) == pytest.approx([10.0, 10.0], abs=0.5)
    held_until = program(segment("motion", 0.0, 2.0), stroke, rest, at=wandering)  # not yet let go
    assert forces_of(held_until[1]) == pytest.approx([11.1, 12.6], abs=0.1)


@pytest.mark.parametrize("grips", [(), (GripperAction(5.2, "open", 0.08),)])
def test_what_is_in_the_air_after_a_contact_is_no_bias_where_it_is_more_than_that(
    grips: tuple[GripperAction, ...],
) -> None:
    left_n = 2.0 if grips else 9.0
    stroke, off = segment("sliding", 2.0, 5.0, **held(20.0), **ACROSS), segment("motion", 5.0, 8.0, **OFF)
    at = lambda t: drifted(t, pushed_n=0.0 if t < 2.0 else 20.0 if t < 5.0 else left_n)  # noqa: E731
    apps = program(segment("motion", 0.0, 2.0), stroke, off, at=at, grips=grips)
    assert forces_of(apps[1]) == pytest.approx([20.0], abs=1e-6)


def test_the_force_of_a_spring_on_the_way_to_a_press_is_no_bias() -> None:
    """A cushion that was held with 15 N was pressed with 10.1 N, without a finding."""

    def pushed(t: float) -> Moment:
        rise = np.interp(t, [1.0, 2.2, 3.2, 4.4], [0.0, 1.0, 1.0, 0.0])
        return drifted(t, pushed_n=15.0 * float(rise**2 * (3.0 - 2.0 * rise)))

    made = program(
        segment("steady", 0.0, 1.0),
        segment("motion", 1.0, 2.2),
        segment("contact", 2.2, 3.2, **held(15.0)),
        segment("motion", 3.2, 4.4),
        segment("steady", 4.4, 5.4),
        at=pushed,
    )
    presses = [one.force for one in made if one.kind == "apply_force"]
    assert presses == [pytest.approx((0.0, 0.0, -15.0), abs=1.0)]


def test_the_inertia_of_the_tool_that_brakes_before_a_contact_is_no_bias() -> None:
    """A robot brought a peg of 0.5 kg down at its fastest: what it pressed with seemed 20 % larger."""

    def braking(t: float) -> Moment:
        share = min(max(t - 1.0, 0.0), 1.0)  # of a way of 0.3 m down, with the least jerk
        way_m = 0.3 * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        down_m_per_s2 = 0.3 * 60.0 * share * (1.0 - share) * (1.0 - 2.0 * share)
        pushed_n = 1.3 * down_m_per_s2 if t < 2.0 else 10.0
        return replace(drifted(t, pushed_n=pushed_n), position=(0.0, 0.0, -way_m))

    begun, down = (0.0, 0.0, -0.03), (0.0, 0.0, -0.3)
    apps = program(
        segment("motion", 0.0, 1.25, position_start=(0.0, 0.0, 0.0), position_end=begun),
        segment("motion", 1.25, 2.0, position_start=begun, position_end=down),
        segment("contact", 2.0, 5.0, **held(10.0), position_start=down, position_end=down),
        at=braking,
    )
    assert apps[-1].force_taught == pytest.approx((0.0, 0.0, -10.0), abs=0.8)


def test_what_is_touched_at_the_very_end_of_a_way_is_no_bias() -> None:
    """The first 2.7 N of a press seemed to be a bias that rises, in which 20 % of the press were lost."""

    def touching(t: float) -> Moment:
        pushed_n = 10.0 if 2.0 <= t < 5.0 else 2.7 if 1.7 <= t < 2.0 else 0.0
        height_m = 0.2 - 0.2 * min(t, 1.7) / 1.7 + 0.2 * min(max(t - 5.0, 0.0), 1.0)
        return replace(drifted(t, pushed_n=pushed_n), position=(0.0, 0.0, height_m))

    here, above = (0.0, 0.0, 0.0), (0.0, 0.0, 0.2)
    apps = program(
        segment("motion", 0.0, 2.0, position_start=above, position_end=here),
        segment("contact", 2.0, 5.0, **held(10.0), position_start=here, position_end=here),
        segment("motion", 5.0, 6.0, position_start=here, position_end=above),
        at=touching,
    )
    assert apps[1].force_taught == pytest.approx((0.0, 0.0, -10.0), abs=0.3)


def test_what_is_still_touched_at_the_start_of_a_way_is_no_bias() -> None:
    """A peg that bounced at its hole seemed to be searched for with 5 N in place of 10 N."""

    def bouncing(t: float) -> Moment:
        pushed_n = 10.0 if t >= 2.45 else 5.5 if 1.0 <= t < 2.15 else 0.0
        return drifted(t, pushed_n=pushed_n)

    apps = program(
        segment("motion", 0.0, 1.0),
        segment("contact", 1.0, 2.0, **held(5.5)),
        segment("motion", 2.0, 2.4),
        segment("contact", 2.4, 5.0, **held(10.0)),
        at=bouncing,
    )
    assert apps[-1].force_taught == pytest.approx((0.0, 0.0, -10.0), abs=0.5)


def test_the_bias_is_read_where_the_tool_stands_before_it_presses() -> None:
    """A robot stood for 0.6 s where it pressed then: those readings were left out, as if they were pushed."""

    def standing(t: float) -> Moment:
        pushed_n = 12.5 if t >= 2.0 else 2.5 if t >= 1.2 else 0.0
        return replace(drifted(t, pushed_n=pushed_n), position=(0.0, 0.0, 0.2 - 0.2 * min(t, 1.2) / 1.2))

    here, above = (0.0, 0.0, 0.0), (0.0, 0.0, 0.2)
    apps = program(
        segment("motion", 0.0, 2.0, position_start=above, position_end=here),
        segment("contact", 2.0, 5.0, **held(12.5), position_start=here, position_end=here),
        at=standing,
    )
    assert apps[-1].force_taught == pytest.approx((0.0, 0.0, -10.0), abs=1.0)


def test_the_bias_wanders_up_to_the_contact_in_which_the_fingers_grip() -> None:
    """What a peg was set down with was 13 % too strong: the bias was that of the second before the touch."""

    def wandering(t: float) -> Moment:
        return drifted(t, pushed_n=-1.5 * min(t, 2.0) + (10.0 if t >= 2.0 else 0.0))

    apps = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 5.0, **held(7.0)),
        segment("motion", 5.0, 7.0),
        at=wandering,
        grips=(GripperAction(4.0, "open", 0.08),),
    )
    assert apps[1].force_taught == pytest.approx((0.0, 0.0, -10.0), abs=0.5)


@pytest.mark.parametrize(("risen_n", "newton"), [(6.0, -5.0), (10.0, -15.0)])
def test_a_bias_that_wanders_on_the_way_to_a_contact_is_no_spring(risen_n: float, newton: float) -> None:
    """The contour that a UR followed lost its path: its bias had wandered by 5 N on the way there."""

    def at(t: float) -> Moment:
        return drifted(t, pushed_n=min(t / 2.0, 1.0) * risen_n + (5.0 if t >= 2.0 else 0.0))

    apps = program(segment("motion", 0.0, 2.0), segment("contact", 2.0, 4.0, **held(risen_n + 5.0)), at=at)
    assert apps[-1].force_taught is not None
    assert apps[-1].force_taught[2] == pytest.approx(newton, abs=2.0)
