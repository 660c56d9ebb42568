"""Where a contact is left."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from caesura_service.program import Moment
from service.program.segments import ACROSS, DRIFT_N, drifted, held, kinds, program, segment, stopping_at


@pytest.mark.parametrize(("pressed_until", "becomes"), [(3.8, []), (3.1, ["cartesian_motion"])])
def test_a_way_in_the_air_after_a_contact_is_a_movement(pressed_until: float, becomes: list[str]) -> None:
    """Lifting off by 13 mm was left out, as if it were the contact's force that decays."""
    off = {"position_start": (0.0, 0.0, 0.300), "position_end": (0.0, 0.0, 0.313)}
    fading = {"force_start": (0.0, 0.0, 13.0), "force_end": (0.0, 0.0, 3.0)}

    def lifted(t: float) -> Moment:
        pressed = drifted(t, pushed_n=10.0 if 2.0 < t < pressed_until else 0.0)
        return replace(pressed, position=(0.0, 0.0, 0.300 + 0.013 * min(max((t - 3.0) / 0.9, 0.0), 1.0)))

    made = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 3.0, **held(10.0), position_start=(0.0, 0.0, 0.300)),
        segment("motion", 3.0, 3.9, **off, **fading),
        at=lifted,
    )
    assert kinds(made) == ["move_to_contact", "apply_force", *becomes]


@pytest.mark.parametrize(
    ("pressed_until", "becomes"), [(3.15, "cartesian_motion"), (3.45, "apply_force"), (9.0, "apply_force")]
)
def test_a_slide_on_which_the_force_of_the_stroke_before_it_decays_is_in_the_air(
    pressed_until: float, becomes: str
) -> None:
    """A robot left a stroke at once, up and aside. A slide of 108 mm became another stroke."""
    way = {"position_start": (0.1, 0.0, 0.2), "position_end": (0.18, 0.0, 0.26)}

    def at(t: float) -> Moment:
        share = min(max((t - 3.1) / 0.5, 0.0), 1.0)
        pressed = drifted(t, pushed_n=10.0 if 2.0 < t < pressed_until else 0.0)
        return replace(pressed, position=(0.1 + 0.08 * share, 0.0, 0.2 + 0.06 * share))

    made = program(
        segment("motion", 0.0, 2.0),
        segment("sliding", 2.0, 3.0, **held(10.0), **ACROSS),
        segment("sliding", 3.0, 3.6, **held(9.0), **way),
        at=at,
    )
    assert kinds(made)[-1] == becomes


@pytest.mark.parametrize(
    ("hit_s", "then", "becomes"),
    [
        (0.1, "motion", ["move_to_contact", "apply_force"]),
        (0.3, "motion", ["move_to_contact", "apply_force", "move_to_contact", "apply_force"]),
        (0.1, "contact", ["move_to_contact", "apply_force"]),
    ],
    ids=["it bounces", "it presses", "it stays"],
)
def test_a_surface_that_is_only_hit_is_not_pressed(hit_s: float, then: str, becomes: list[str]) -> None:
    """A hand hit a table, bounced, and came down again: the robot was to press with 42 N."""

    def at(t: float) -> Moment:
        hits, presses = 2.6 - hit_s < t < 2.6, t > 3.0 or (then == "contact" and t > 2.5)
        felt = drifted(t, pushed_n=42.0 if hits else 12.0 if presses else 0.0)
        return replace(felt, position=(0.05 * (t - 2.2), 0.0, 0.04 - 0.1 * (t - 2.2)))

    down = {"position_start": (0.0, 0.0, 0.04), "position_end": (0.02, 0.0, 0.0)}
    made = program(
        segment("motion", 0.0, 2.2),
        segment("sliding", 2.2, 2.6, **held(42.0), **down),
        segment(then, 2.6, 3.0, **(held(12.0) if then == "contact" else {})),
        segment("contact", 3.0, 4.5, **held(12.0)),
        at=at,
    )
    assert kinds(made) == becomes
    assert max(math.hypot(*one.force) for one in made if one.force) == pytest.approx(
        42.0 if hit_s > 0.1 else 12.0, abs=1.5
    )


def test_what_springs_back_after_a_press_takes_the_hand_along() -> None:
    """A pump came up by 16 mm of 25, and the next movement led through it: the check refused that."""
    made = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 3.0, **held(10.0), position_start=(0.0, 0.0, 0.325)),
        segment(
            "motion", 3.0, 3.4, position_start=(0.0, 0.0, 0.3), position_end=(0.0, 0.0, 0.316),
            force_start=(0.0, 0.0, 13.0), force_end=(0.0, 0.0, 3.0),
        ),
        at=lambda t: replace(
            drifted(t, pushed_n=10.0 if 2.0 < t < 3.1 else 0.0),
            position=(0.0, 0.0, 0.325 if t < 2.1 else 0.3),
        ),
    )  # fmt: skip
    assert kinds(made) == ["move_to_contact", "apply_force"]


def test_a_contact_that_begins_on_the_way_down_is_left_from_where_it_was_touched() -> None:
    """Its segment began 13 mm above the surface, so lifting off by 12 mm seemed to stay within it."""

    def at(t: float) -> Moment:
        height = 0.313 if t < 2.1 else 0.3 if t < 3.0 else 0.3 + 0.012 * min((t - 3.0) / 0.6, 1.0)
        return replace(drifted(t, pushed_n=10.0 if 2.1 < t < 3.0 else 0.0), position=(0.0, 0.0, height))

    made = program(
        segment("motion", 0.0, 2.0),
        segment("contact", 2.0, 3.0, **held(10.0), position_start=(0.0, 0.0, 0.313)),
        segment(
            "motion", 3.0, 3.6, position_start=(0.0, 0.0, 0.3), position_end=(0.0, 0.0, 0.312),
            force_start=(0.0, 0.0, 13.0), force_end=(0.0, 0.0, 3.0),
        ),
        at=at,
    )  # fmt: skip
    assert kinds(made) == ["move_to_contact", "apply_force", "cartesian_motion"]


@pytest.mark.parametrize(("left_m", "aside_m", "moves"), [(0.02, 0.0, 1), (0.03, 0.0, 2), (0.02, 0.05, 2)])
def test_what_does_not_leave_what_was_pressed_in_is_part_of_the_movement(
    left_m: float, aside_m: float, moves: int
) -> None:
    """A movement out of a pump was divided inside of it. The robot's was not."""

    def pumped(t: float) -> Moment:
        z = 0.2 - 0.025 * np.clip(t - 2.0, 0.0, 1.0) + 0.02 * max(math.floor((t - 3.4) / 0.2 + 1e-9), 0)
        return replace(drifted(t, pushed_n=9.0 if 2.0 < t < 3.4 else 0.0), position=(0.0, 0.0, float(z)))

    below, divided = (0.0, 0.0, 0.175), (aside_m, 0.0, 0.175 + left_m)
    made = program(
        segment("motion", 0.0, 2.0),
        segment("sliding", 2.0, 3.0, **held(9.0), position_start=(0.0, 0.0, 0.2), position_end=below),
        segment("contact", 3.0, 3.4, **held(9.0), position_start=below, position_end=below),
        segment("motion", 3.4, 3.8, position_start=below, position_end=divided),
        segment("motion", 3.8, 5.0, position_start=divided, position_end=(0.1, 0.0, 0.4)),
        at=pumped,
    )
    assert kinds(made)[2:] == ["cartesian_motion"] * moves


def test_a_movement_up_from_the_end_of_a_stroke_has_left_it() -> None:
    """Friction tilts the force of a long stroke: by that, 2 cm up was still below where it was touched."""
    along = {"position_start": (0.0, 0.0, 0.2), "position_end": (0.3, 0.0, 0.2)}
    up, on = (0.3, 0.0, 0.22), (0.3, 0.0, 0.4)
    made = program(
        segment("motion", 0.0, 2.0),
        segment("sliding", 2.0, 4.0, force_held=(DRIFT_N[0] - 4.0, DRIFT_N[1], DRIFT_N[2] + 9.0), **along),
        segment("motion", 4.0, 4.4, position_start=along["position_end"], position_end=up),
        segment("motion", 4.4, 6.0, position_start=up, position_end=on),
        at=lambda t: drifted(t, pushed_n=9.0 if 2.0 < t < 4.0 else 0.0, at=stopping_at),
    )
    assert kinds(made)[-2:] == ["cartesian_motion"] * 2
