"""Fingers that move without an event are in no app, and the program names them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from caesura_service.program import GripperAction, unreproduced_finger_motion

T = np.arange(0.0, 20.0, 0.1)
GRASP, OPEN = GripperAction(6.0, "grasp", 0.03), GripperAction(12.0, "open", 0.08)


def said(times: Sequence[float], openings: Sequence[float], *grips: GripperAction) -> list[str]:
    return list(unreproduced_finger_motion(T, np.interp(T, times, openings), grips))


def test_fingers_that_close_slower_than_any_event_are_named_until_they_are_open_again():
    """At 6 mm/s they closed on a part, and neither the program nor a finding had a grasp."""
    assert said((4.0, 12.0, 15.0, 15.2), (0.08, 0.03, 0.03, 0.08)) == [
        "the fingers from 80 to 30 mm at 4.8–15.1 s"
    ]


def test_fingers_that_still_close_as_the_recording_ends_are_named():
    assert said((19.5, 19.9), (0.08, 0.03)) == ["the fingers from 80 to 30 mm at 19.6–19.9 s"]


@pytest.mark.parametrize("seconds", [0.2, 2.0])
def test_a_motion_that_an_event_ends_or_begins_is_in_its_app(seconds: float):
    times = (6.0 - seconds, 6.0, 12.0, 12.0 + seconds)
    assert said(times, (0.08, 0.03, 0.03, 0.08), GRASP, OPEN) == []
    assert len(said(times, (0.08, 0.03, 0.03, 0.08), GRASP)) == 1
    assert len(said(times, (0.08, 0.03, 0.03, 0.08), OPEN)) == 1


def test_one_wrong_reading_and_a_part_that_gives_way_are_no_motion():
    openings = np.full(T.size, 0.08)
    openings[50] = 0.0
    assert list(unreproduced_finger_motion(T, openings, ())) == []
    assert said((6.0, 7.0, 19.0), (0.03, 0.03, 0.027), GRASP) == []


def test_a_flag_and_a_robot_without_a_gripper_have_no_openings():
    assert list(unreproduced_finger_motion(T, np.full(T.size, np.nan), (GRASP,))) == []
    assert said((6.0, 6.2), (0.08, 0.0), GripperAction(6.1, "grasp", None)) == []
    assert list(unreproduced_finger_motion(np.empty(0), np.empty(0), ())) == []


def test_of_a_noisy_column_the_widest_motions_are_named():
    openings = np.random.default_rng(3).uniform(0.0, 0.08, T.size)
    found = list(unreproduced_finger_motion(T, openings, ()))
    assert len(found) == 4
    assert found[-1].endswith(" shorter motions of the fingers")


FLICK, OF_A_FLAG = (8.0, 8.1, 0.03, 0.07), (9.0, 9.1, math.nan, math.nan)


def test_fingers_that_open_and_close_again_between_two_observations_are_named_once():
    """Fingers that opened for 0.1 s dropped the part, and neither the program nor a finding had it."""
    still = np.full(T.size, 0.03)
    assert list(unreproduced_finger_motion(T, still, (), (FLICK, OF_A_FLAG))) == [
        "the fingers from 30 to 70 mm at 8.0–8.1 s",
        "fingers that moved and moved back at 9.0–9.1 s",
    ]
    seen = np.where((T > 7.95) & (T < 8.15), 0.07, 0.03)
    assert list(unreproduced_finger_motion(T, seen, (), (FLICK,))) == [
        "the fingers from 30 to 70 mm at 8.0–8.1 s"
    ]


def test_of_many_motions_of_the_fingers_the_widest_are_named():
    many = [(float(k), k + 0.1, 0.03, 0.04 + 0.001 * k) for k in range(5)]
    found = list(unreproduced_finger_motion(T, np.full(T.size, np.nan), (), many))
    assert found == [
        "the fingers from 30 to 42 mm at 2.0–2.1 s",
        "the fingers from 30 to 43 mm at 3.0–3.1 s",
        "the fingers from 30 to 44 mm at 4.0–4.1 s",
        "2 shorter motions of the fingers",
    ]
