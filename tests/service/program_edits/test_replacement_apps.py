"""A session gives its apps for a part of another program only where the two fit together."""

from __future__ import annotations

import math
from typing import Any

import pytest

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import App, AppChange, AppPath, Gap, Program, ViaPoint
from caesura_service.program_edits.replacement_apps import apps_for
from harness.programs import app, pick_and_place

MOST_VIA_POINTS = 64
POINT = ViaPoint(t=1.0, position=(0.1, 0.2, 0.3), orientation=(0.0, 0.0, 0.0, 1.0), velocity=(0.1, 0.2, 0.3))


def program(session: str = "s2", apps: tuple[App, ...] = pick_and_place()[:2], **stated: Any) -> Program:
    fields = {"station": "cell-1", "instance": "test-1", "epoch": 1, "version": 4, "t": 12.0}
    return Program(**({"complete": True, "robot": "panda"} | fields | stated), session=session, apps=apps)


def long_paths(count: int) -> tuple[App, ...]:
    path = AppPath(
        start=POINT,
        via=(POINT,) * MOST_VIA_POINTS,
        tn=2.0,
        length_m=0.1,
        deviation_m=0.0,
        deviation_rad=0.0,
        tolerance_m=0.002,
        tolerance_rad=0.02,
    )
    return (app("cartesian_motion", 0.0, 2.0, POINT.position, path=path),) * count


def test_the_apps_are_those_of_the_edited_program_as_they_are():
    assert apps_for(program("s1"), program()) == pick_and_place()[:2]


@pytest.mark.parametrize(
    ("taught_again", "code", "reason"),
    [
        (program(robot="ur5e"), "conflict", "another robot than the program"),
        (program(robot=None), "conflict", "another robot than the program"),
        (program(up=(0.0, 0.0, -1.0)), "conflict", "on a base that is mounted otherwise"),
        (program(complete=False), "conflict", "still open"),
        (program(apps=()), "conflict", "no apps"),
        (program(gaps=(Gap(t0=0.5, tn=0.6, reason="evicted"),)), "conflict", "lost samples within its apps"),
        (program("s1"), "conflict", "replaces no part of itself"),
        (program(apps=pick_and_place()[:1] * 101), "too_large", "too many apps"),
        (program(apps=long_paths(100)), "too_large", "too long paths"),
    ],
)
def test_a_session_that_does_not_fit_is_refused_in_plain_words(taught_again: Program, code: str, reason: str):
    with pytest.raises(ProtocolError, match=reason) as refused:
        apps_for(program("s1"), taught_again)
    assert refused.value.code == code


def test_a_base_that_is_mounted_alike_within_the_reading_of_a_level_is_the_same_one():
    leaning = math.sin(0.05), 0.0, math.cos(0.05)
    assert apps_for(program("s1", up=(0.0, 0.0, 1.0)), program(up=leaning)) == pick_and_place()[:2]
    assert apps_for(program("s1"), program(up=leaning)) == pick_and_place()[:2]


def test_a_gap_outside_the_apps_does_no_harm():
    gaps = (Gap(t0=50.0, tn=51.0, reason="evicted"),)
    assert apps_for(program("s1"), program(gaps=gaps)) == pick_and_place()[:2]


def test_apps_whose_order_or_speed_people_changed_are_taken_as_they_are_run():
    first, second = pick_and_place()[:2]
    moved = second.model_copy(update={"changes": (AppChange(field="place", author="Ann", edit=1),)})
    slow = first.model_copy(update={"speed": 0.5})
    given = apps_for(program("s1"), program(apps=(moved, slow)))
    assert [one.kind for one in given] == [second.kind, first.kind]
    assert given[0].t0 >= 0.0
    assert given[1].t0 == pytest.approx(given[0].tn)
    assert given[1].tn - given[1].t0 == pytest.approx(2.0 * (first.tn - first.t0))
    assert [one.speed for one in given] == [None, None]
