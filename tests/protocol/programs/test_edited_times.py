"""Times of a program whose order or speeds people changed, and two programs compared in words."""

from __future__ import annotations

from typing import Any

import pytest

from caesura_protocol.messages import (
    App,
    AppChange,
    AppPath,
    AppReference,
    DeleteApp,
    Gap,
    Program,
    ProgramEdit,
    ViaPoint,
)
from caesura_protocol.programs.checks import document_findings
from caesura_protocol.programs.comparison import differences
from caesura_protocol.programs.document import ProgramFile, document
from caesura_protocol.programs.export_formats import WRITERS
from caesura_protocol.programs.program_speed import at_factor
from harness.programs import app, pick_and_place

PLACE = AppChange(field="place", author="Ann", edit=1)


def written(*apps: App, **changes: Any) -> ProgramFile:
    fields = {"station": "cell-1", "session": "s1", "instance": "test-1", "epoch": 1, "version": 4, "t": 12.0}
    return document(Program(**fields, complete=True, apps=apps, **changes))


def times(program: ProgramFile) -> list[tuple[float, float]]:
    return [(pytest.approx(one.t0, abs=1e-5), pytest.approx(one.tn, abs=1e-5)) for one in program.apps]


def movement(t0: float, tn: float, **fields: Any) -> App:
    start = ViaPoint(t=t0, position=(0.0, -0.5, 0.2), orientation=None)
    via = ViaPoint(t=(t0 + tn) / 2, position=(0.05, -0.5, 0.25), orientation=None, velocity=(0.1, 0.0, 0.0))
    path = AppPath(
        start=start,
        via=(via,),
        tn=tn,
        length_m=0.15,
        deviation_m=0.0,
        deviation_rad=0.0,
        tolerance_m=0.002,
        tolerance_rad=0.02,
    )
    return app("cartesian_motion", t0, tn, (0.1, -0.5, 0.2), path=path, **fields)


def test_a_program_without_edits_of_order_or_speed_keeps_every_time():
    apps = pick_and_place()
    named = (apps[0].model_copy(update={"name": "above"}), *apps[1:])
    assert [(one.t0, one.tn) for one in written(*named).apps] == [(one.t0, one.tn) for one in apps]


def test_an_app_at_its_own_speed_moves_what_follows_and_keeps_the_pause():
    slow = movement(1.0, 3.0, speed=0.5)
    program = written(slow, movement(4.0, 5.0), gaps=(Gap(t0=1.0, tn=2.0, reason="source"),))
    assert times(program) == [(1.0, 5.0), (6.0, 7.0)]
    path = program.apps[0].path
    assert path is not None
    assert (path.via[0].t, path.via[0].velocity, path.tn) == (3.0, (0.05, 0.0, 0.0), 5.0)
    assert program.gaps == (Gap(t0=1.0, tn=3.0, reason="source"),)
    assert "edited" in program.units["time"]
    faster = at_factor(program, 2.0)
    assert times(faster) == [(1.0, 3.0), (4.0, 4.5)]


def test_apps_in_another_order_follow_each_other_without_a_pause():
    first, second, third = movement(1.0, 2.0), movement(2.5, 3.5), movement(4.0, 6.0)
    program = written(third.model_copy(update={"changes": (PLACE,)}), first, second)
    assert times(program) == [(1.0, 3.0), (3.0, 4.0), (4.5, 5.5)]
    assert all(one.t0 <= two.t0 for one, two in zip(program.apps, program.apps[1:], strict=False))


def test_the_time_of_a_deleted_app_is_no_pause():
    gone = AppReference(kind="cartesian_motion", t0=2.5, tn=3.5)
    edit = ProgramEdit(number=1, author="Ann", at=0.0, action=DeleteApp(app=gone), state="applied")
    program = written(movement(1.0, 2.0), movement(4.0, 6.0), edits=(edit,))
    assert times(program) == [(1.0, 2.0), (2.0, 4.0)]


def test_a_name_is_what_robots_formats_show():
    program = written(movement(1.0, 2.0, name='Push "in"'))
    assert "1 Push &quot;in&quot;" in WRITERS["bt"].write(program)
    assert "'title': 'Push \"in\"'" in WRITERS["franky"].write(program)


def test_two_programs_are_compared_app_by_app():
    before = written(*pick_and_place())
    assert differences(before, before) == []
    a, b, c, *rest = pick_and_place()
    moved = a.model_copy(update={"target": (-0.014, -0.653, 0.107), "name": "above"})
    narrow = b.model_copy(update={"gripper_width": 0.04})
    after = written(moved, narrow, *rest, name="pick")
    assert differences(after, before) == [
        "program: name 'pick', was none",
        "app 1 (above): name 'above', was none; target 20.0 mm away",
        "app 2 (grasp): gripper width 40 mm, was 50 mm",
        "without what was app 3 (transport)",
    ]
    assert differences(before, after)[-1] == "app 3 (transport) is added"
    assert c.kind == "transport"


def test_a_difference_states_which_program_counts_an_app_so():
    before = written(*pick_and_place())
    first, second, _, fourth, opened, retract = pick_and_place()
    wide = opened.model_copy(update={"gripper_width": 0.07})
    assert differences(written(first, second, fourth, wide, retract), before) == [
        "without what was app 3 (transport)",
        "app 4 (move gripper), was app 5: gripper width 70 mm, was 80 mm",
    ]


def test_a_check_accepts_the_times_of_another_order():
    first, second, third = movement(1.0, 2.0), movement(2.5, 3.5), movement(4.0, 6.0)
    copied = second.model_copy(update={"added": 2, "changes": (PLACE,)})
    program = written(third.model_copy(update={"changes": (PLACE,)}), first, second, copied)
    assert [str(one) for one in document_findings(program) if one.severity == "error"] == []
