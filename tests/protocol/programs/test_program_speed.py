"""A program at a factor of its speed: movements are scaled, and everything in contact keeps its bits."""

from __future__ import annotations

import numpy as np
import pytest

from caesura_protocol.errors import CaesuraError
from caesura_protocol.messages import AppPath, Gap, ScrewMotion, ViaPoint
from caesura_protocol.programs.checks import timing_findings
from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.programs.document_timing import ProgramTiming, ShorterPause
from caesura_protocol.programs.program_speed import at_factor, factor_of, may_retime, retimed
from caesura_protocol.reproduced_path import curve_of
from harness.programs import DOWN, app, as_file

HOME, DEEP = (-0.02, -0.6, 0.3), (-0.02, -0.52, 0.165)


def path(t0: float, tn: float, length_m: float = 0.2) -> AppPath:
    middle = ViaPoint(
        t=t0 + 0.3 * (tn - t0), position=(-0.02, -0.55, 0.28), orientation=DOWN, velocity=(0, 0.1, -0.1)
    )
    start = ViaPoint(t=t0, position=HOME, orientation=DOWN)
    within = {"deviation_m": 0, "deviation_rad": 0, "tolerance_m": 0.002, "tolerance_rad": 0.02}
    return AppPath(start=start, via=(middle,), tn=tn, length_m=length_m, **within)


def taught() -> ProgramFile:
    press = app("apply_force", 2.1, 3.7000000000000006, DEEP, force=(0, 0, -9), path=path(2.1, 3.7))
    hold = app("hold", 6.3, 7.6, DEEP, load_kg=0.2, path=path(6.3, 7.6))
    apps = (
        app("move_to_contact", 0.35, 2.1, DEEP, path=path(0.3, 2.2)),
        press,
        app("cartesian_motion", 4.2, 6.3, HOME, path=path(4.2, 6.3)),
        hold,
    )
    return as_file(apps).model_copy(update={"gaps": (Gap(t0=3.0, tn=5.25, reason="source"),)})


def test_a_movement_at_half_its_speed_takes_twice_its_time_along_the_same_path() -> None:
    slow, before = at_factor(taught(), 0.5), taught()
    for index in (0, 2):
        one, other = slow.apps[index], before.apps[index]
        assert one.tn - one.t0 == pytest.approx(2 * (other.tn - other.t0))
        there, here = curve_of(other), curve_of(one)
        for share in np.linspace(0.0, 1.0, 21):
            at = other.path.start.t + share * (other.path.tn - other.path.start.t)
            mapped = one.t0 + 2 * (at - other.t0)
            np.testing.assert_allclose(here.at(mapped)[0], there.at(at)[0], atol=1e-9)
            np.testing.assert_allclose(2 * here.at(mapped)[1], there.at(at)[1], atol=1e-8)
    assert slow.timing == ProgramTiming(speed=0.5, retimed=(0, 2), taught_s=7.25, seconds=slow.timing.seconds)
    assert slow.timing.seconds == pytest.approx(7.25 + 1.75 + 2.1)


def test_a_faster_program_keeps_contact_and_holds_to_the_last_bit() -> None:
    fast, before = at_factor(taught(), 1.7), taught()
    for index in (1, 3):
        one, other = fast.apps[index], before.apps[index]
        assert one.t0 < other.t0
        assert one.tn - one.t0 == other.tn - other.t0
        offsets = [
            [point.t - a.path.start.t for point in a.path.via] + [a.path.tn - a.t0] for a in (one, other)
        ]
        assert offsets[0] == offsets[1]
        same = {"t0", "tn", "path"}
        assert one.model_dump(exclude=same) == other.model_dump(exclude=same)
        assert [p.model_dump(exclude={"t"}) for p in one.path.via] == [
            p.model_dump(exclude={"t"}) for p in other.path.via
        ]
    pauses = [b.t0 - a.tn for p in (fast, before) for a, b in zip(p.apps, p.apps[1:], strict=False)]
    assert pauses[:3] == pytest.approx(pauses[3:], abs=2e-6)


def test_a_gap_stays_in_its_apps() -> None:
    (gap,) = at_factor(taught(), 0.5).gaps
    apps = at_factor(taught(), 0.5).apps
    assert gap.t0 - apps[1].t0 == pytest.approx(0.9)
    assert gap.tn - apps[2].t0 == pytest.approx(2 * 1.05)


def test_turns_and_what_only_turns_are_not_movements() -> None:
    (moving,) = (one for one in taught().apps if one.kind == "cartesian_motion")
    screw = ScrewMotion(axis=(0, 0, 1), point=HOME, angle=1.0, pitch_m=0.0, pitch_sd_m=0.1, torque=None)
    assert may_retime(moving)
    assert not may_retime(moving.model_copy(update={"screw": screw}))
    assert not may_retime(moving.model_copy(update={"path": None}))
    turned = moving.model_copy(update={"orientation": (0.0, 1.0, 0.0, 0.0), "path": path(4.2, 6.3, 0.02)})
    assert not may_retime(turned)


@pytest.mark.parametrize("text", ["0.05", "3", "-1", "nan", "quick"])
def test_a_speed_out_of_its_range_is_refused(text: str) -> None:
    with pytest.raises(CaesuraError, match=f"'{text}' is not possible, expected taught, optimal or a factor"):
        factor_of(text)


def test_a_program_is_retimed_once() -> None:
    with pytest.raises(CaesuraError, match=r"re-timed already \(speed 0.5\)"):
        at_factor(at_factor(taught(), 0.5), 0.5)
    with pytest.raises(CaesuraError, match="no pause before app 5, expected an app from 2 to 4"):
        at_factor(taught(), 0.5, keeps_pause=[4])


def test_a_document_says_how_it_is_timed_and_one_without_is_as_taught() -> None:
    slow = at_factor(taught(), 0.5)
    assert ProgramFile.model_validate_json(slow.as_json()) == slow
    content = taught().model_dump()
    del content["timing"]
    assert ProgramFile.model_validate(content).timing is None


def test_the_pauses_that_a_faster_program_leaves_out_are_named() -> None:
    # A pause of 12 s, in which glue set, was gone from an optimal program, and no finding named it.
    fast = retimed(taught(), {}, "optimal", lambda index, taught_s: 0.0)
    said = [one.reason for one in timing_findings(fast.timing)]
    assert said[1:] == ["taught pauses are left out: 0.5 s before app 3; to keep one: --keep-pause 3"]
    half = retimed(taught(), {}, "optimal", lambda index, taught_s: 0.2 * taught_s)
    assert "0.5 s before app 3 (0.1 s now)" in [one.reason for one in timing_findings(half.timing)][1]
    kept = retimed(taught(), {}, "optimal", lambda index, taught_s: 0.0, keeps_pause=[2])
    assert len(list(timing_findings(kept.timing))) == 1
    assert at_factor(taught(), 2.0).timing.shorter_pauses == ()


def test_of_many_pauses_that_are_left_out_the_longest_are_named() -> None:
    """A program with 200 pauses had a finding of 4000 characters below its table."""
    pauses = tuple(ShorterPause(app=i, taught_s=0.3 + 0.1 * i, seconds=0.0) for i in range(1, 201))
    timing = ProgramTiming(speed="optimal", shorter_pauses=pauses)
    (_, said) = timing_findings(timing)
    assert "19.9 s before app 197, 20.0 s before app 198" in said.reason
    assert said.reason.endswith("20.3 s before app 201 and 195 shorter ones; to keep one: --keep-pause 201")
    assert len(said.reason) < 250
