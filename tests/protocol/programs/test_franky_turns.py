"""The script for franky where it turns: rate and time as taught, its limits, and a turn that is tight."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from caesura_protocol.app_kinds import AppKind
from caesura_protocol.messages import AppPath, ScrewMotion, ViaPoint
from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.programs.safety import Safety
from caesura_protocol.reproduced_path import path_in_words
from harness.programs import DOWN, app, as_file, press

from . import fake_franky
from .franky_runs import module_of, motions, passed, run


def turning(seconds: float, *, by_path: bool) -> ProgramFile:
    """A turn by 90° in place, after a movement."""
    first, turned = press()[2], (0.0, 1.0, 0.0, 0.0)
    moving = app("cartesian_motion", first.tn, first.tn + seconds, first.target, orientation=turned)
    half = Rotation.from_quat([DOWN, turned]).mean().as_quat().tolist()
    path = AppPath(
        start=ViaPoint(t=moving.t0, position=first.target, orientation=DOWN),
        via=(ViaPoint(t=moving.t0 + 0.5 * seconds, position=first.target, orientation=half),),
        tn=moving.tn, length_m=0.0, deviation_m=0.0, deviation_rad=0.0, tolerance_m=0.002, tolerance_rad=0.02,
    )  # fmt: skip
    return as_file((first, moving.model_copy(update={"path": path}) if by_path else moving))


def test_a_turn_is_passed_through_its_via_points_at_the_taught_rate_and_time() -> None:
    calls = run(turning(2.0, by_path=True))
    states = {round(t, 3): state for t, state in passed(motions(calls)[-1])}
    half, end = states[1.0], states[2.0]
    assert np.linalg.norm(half.velocity.angular) == pytest.approx(math.pi / 4, rel=0.1)
    assert half.velocity.angular[2] == pytest.approx(-math.pi / 4, rel=0.1)
    assert end.velocity.angular.tolist() == [0.0, 0.0, 0.0]
    assert [a["value"] for name, a in calls if name == "turn"][-1] < 1.6  # rad/s; mean 0.8


def test_a_turn_is_named_in_words(capsys: pytest.CaptureFixture[str]) -> None:
    program = turning(2.0, by_path=True)
    made = module_of(program)
    made.say(1, made.APPS[1])
    assert "turns 90 degrees  by 1 via points" in capsys.readouterr().out
    assert path_in_words(program.apps[1]) == "0 mm, 90°, 1 via"


@pytest.mark.parametrize("by_path", [True, False])
def test_no_turn_is_faster_than_the_limit_however_short_it_was_taught(by_path: bool) -> None:
    program = turning(0.4, by_path=by_path)
    slow = program.model_copy(update={"safety": Safety(turn_rad_per_s=1.0)})
    calls = run(slow)
    assert [a["value"] for name, a in calls if name == "turn"][-1] == 1.0
    if by_path:
        ways = passed(motions(calls)[-1])
        assert ways[-1][0] > math.pi / 2  # at 1 rad/s
        assert max(np.linalg.norm(state.velocity.angular) for _, state in ways) <= 1.0


def test_a_press_that_turns_is_slowed_to_the_limit() -> None:
    program = turning(0.4, by_path=True)
    touch, pressed, _ = press()
    path = program.apps[1].path.model_copy(update={"tn": program.apps[1].tn})
    turned = program.apps[1].model_copy(update={"kind": "apply_force", "force": pressed.force, "path": path})
    slow = as_file((touch, turned)).model_copy(update={"safety": Safety(turn_rad_per_s=1.0)})
    tracked = next(
        m for m in motions(run(slow)) if isinstance(m, fake_franky.CartesianImpedanceTrackingMotion)
    )
    poses = Rotation.from_quat([one.target.quaternion for one in tracked.references[1:]])
    assert (poses[1:] * poses[:-1].inv()).magnitude().max() <= 1.0 * 0.02 + 1e-6  # rad a period


@pytest.mark.parametrize("kind", ["cartesian_motion", "apply_force"])
@pytest.mark.parametrize(("felt_nm", "tight"), [(1.4, False), (1.6, True), (-1.6, True)])
def test_a_turn_ends_where_it_is_tight(
    monkeypatch: pytest.MonkeyPatch, kind: AppKind, felt_nm: float, tight: bool
) -> None:
    first, turned = turning(2.0, by_path=True).apps
    screw = ScrewMotion(
        axis=(0, 0, 1), point=(0, 0, 0), angle=1.6, pitch_m=0.001, pitch_sd_m=0.0, torque=(0.0, 0.0, 1.0)
    )
    app = turned.model_copy(update={"kind": kind, "screw": screw, "force": (0.0, 0.0, -5.0)})
    made = module_of(as_file((first.model_copy(update={"kind": "move_to_contact"}), app)))
    assert made.APPS[1]["tight"][2] == 1.5  # of 1 Nm taught
    runner = made.Runner(fake_franky, "robot")
    monkeypatch.setattr(fake_franky, "torque_nm", [felt_nm])
    joins = iter([False] * 200)
    monkeypatch.setattr(fake_franky.Robot, "join_motion", lambda self, timeout=None: next(joins, True))
    fake_franky.calls.clear()
    runner.moved = True
    runner.robot.flange = fake_franky.Affine(app.path.start.position, DOWN)
    try:
        getattr(runner, kind)(made.APPS[1], None)
    finally:
        polls = 200 - len(list(joins))
    assert polls == 1 if tight else polls > 50
    ended = isinstance(motions(fake_franky.calls)[-1], fake_franky.CartesianStopMotion)
    assert ended == (tight and kind == "cartesian_motion")
