"""Without a limit a press is written as it was taught; no script begins where it would be stopped."""

from __future__ import annotations

import re

import pytest

from caesura_protocol.messages import App
from caesura_protocol.programs.export_formats import WRITERS
from caesura_protocol.programs.safety import Safety
from harness.programs import as_file, press, wiped

from . import franky_runs, xarm_runs
from .fake_ur_controller import Controller, Halted

CELL = Safety(felt_force_n=40.0)  # that lets the robot press as hard


def pressed_hard() -> tuple[App, ...]:
    touch, pressed, away = press()
    return touch, pressed.model_copy(update={"force": (0.0, 0.0, -35.0)}), away


@pytest.mark.parametrize("output_format", ["json", "franky", "urscript", "xarm", "bt"])
def test_it_is_written_as_it_was_taught_with_a_warning(output_format: str):
    # A script was refused: "force 35.0 N, at most 28.5 N are allowed", though no limit was set.
    text = WRITERS[output_format].write(as_file(pressed_hard()))
    assert re.search(r"35(\.0+)?\b", text)
    if output_format != "json":  # `check` computes the findings of a JSON file
        assert "warning: force 35.0 N is above 28.5 N: the robot is stopped at 30 N (felt_force_n)" in text


def test_a_franky_script_does_not_begin_where_it_would_be_stopped():
    made = franky_runs.module_of(as_file(pressed_hard()))
    said = r"app 2 \(apply force\): force 35\.0 N, and the robot is stopped at STOP_FORCE_N, 30\.0 N"
    with pytest.raises(made.Stop, match=said):
        made.checked(made.APPS)
    allowed = franky_runs.module_of(as_file(pressed_hard()).model_copy(update={"safety": CELL}))
    assert allowed.checked(allowed.APPS)


def test_an_xarm_script_does_not_begin_where_it_would_be_stopped():
    program, arm = xarm_runs.on_xarm(pressed_hard()), xarm_runs.Arm()
    made = xarm_runs.module_of(program)
    runner = made.Runner(lambda host, is_radian: arm.api, "10.0.0.3")
    moved = len(arm.calls("set_position_aa"))
    with pytest.raises(made.Stop, match=r"force 35\.0 N, and the robot is stopped at STOP_FORCE_N, 30 N"):
        runner.run(made.APPS)
    assert len(arm.calls("set_position_aa")) == moved
    xarm_runs.run(program.model_copy(update={"safety": CELL}), table_m=0.185)


def test_a_urscript_does_not_begin_where_it_would_be_stopped():
    program = as_file(pressed_hard()).model_copy(update={"robot": "ur5e"})
    controller = Controller(table_m=0.185)
    with pytest.raises(Halted):
        controller.play(WRITERS["urscript"].write(program))
    assert not controller.named("movej", "movel", "movep")
    assert controller.named("popup")[0]["s"].startswith("it presses harder than 0.95 of STOP_FORCE_N")
    allowed = Controller(table_m=0.185)
    allowed.play(WRITERS["urscript"].write(program.model_copy(update={"safety": CELL})))
    assert allowed.named("force_mode")[0]["wrench"][2] == 35.0


def test_no_script_of_a_stroke_begins_whose_friction_would_stop_the_robot():
    """A script presses with 28 N; with the friction of its way the robot feels 31.3 N."""
    touch, stroke = wiped()
    apps = touch, stroke.model_copy(update={"force": (14.0, 0.0, -28.0)})
    said = r"force 31\.3 N, and the robot is stopped at STOP_FORCE_N, 30"
    franky = franky_runs.module_of(as_file(apps))
    with pytest.raises(franky.Stop, match=said):
        franky.checked(franky.APPS)
    arm, xarm = xarm_runs.Arm(), xarm_runs.module_of(xarm_runs.on_xarm(apps))
    with pytest.raises(xarm.Stop, match=said):
        xarm.Runner(lambda host, is_radian: arm.api, "10.0.0.3").run(xarm.APPS)
    assert not arm.calls("set_position_aa")
    controller = Controller(table_m=0.185)
    with pytest.raises(Halted):
        controller.play(WRITERS["urscript"].write(as_file(apps).model_copy(update={"robot": "ur5e"})))
    assert not controller.named("movej", "movel", "movep")


def test_franky_presses_it_where_the_cell_allows_it(monkeypatch: pytest.MonkeyPatch):
    touch, pressed, _ = pressed_hard()
    program = as_file((touch, pressed.model_copy(update={"tn": pressed.t0 + 5.0})))
    program = program.model_copy(update={"safety": CELL})
    felt = franky_runs.pressed_n(monkeypatch, program, lambda x, y: 0.165)
    assert max(felt) == pytest.approx(35.0, rel=0.1)
