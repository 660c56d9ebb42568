"""Targets outside of the workspace: one sentence for each app, one for a program in another frame."""

from __future__ import annotations

from caesura_protocol.messages import App, Vector
from caesura_protocol.programs.checks import workspace_findings
from caesura_protocol.programs.safety import DEFAULT
from harness.programs import app

INSIDE, BEYOND, FAR = (0.4, 0.0, 0.3), (0.4, -1.2, -1.3), (0.4, -1.1, -1.4)


def moves(*targets: Vector) -> list[App]:
    return [app("cartesian_motion", i, i + 1.0, target) for i, target in enumerate(targets)]


def test_a_target_outside_on_two_axes_is_one_finding() -> None:
    # It was one an axis: a program of a tracked tool had three sentences for each of its apps.
    (found,) = workspace_findings(moves(INSIDE, BEYOND, INSIDE), DEFAULT)
    assert (found.severity, found.index) == ("error", 1)
    assert found.reason == (
        "target y -1200 mm is outside of the workspace, -750 to 750 mm; z -1300 mm, -50 to 900 mm"
    )


def test_a_program_of_another_frame_is_one_finding() -> None:
    targets = (BEYOND, FAR, BEYOND, FAR, INSIDE)
    (found,) = workspace_findings(moves(*targets), DEFAULT)
    assert (found.severity, found.index, found.kind) == ("error", None, None)
    assert "4 of 5 targets are outside of the workspace" in found.reason
    assert "--" in found.reason
    assert "--" not in str(found.on_page), "a page has no options"
    assert "such as app 1 at (400, -1200, -1300) mm. Were they stated in another base frame?" in found.reason
    assert "--cell" in found.reason
    assert [one.index for one in workspace_findings(moves(*targets, INSIDE), DEFAULT)] == [0, 1, 2, 3]


def test_a_program_in_another_unit_is_one_finding() -> None:
    (found,) = workspace_findings(moves((400.0, 0.0, 300.0), (420.0, 10.0, 300.0)), DEFAULT)
    assert found.reason.endswith("They are probably in mm")


def test_the_only_target_is_named_by_its_app() -> None:
    assert [one.index for one in workspace_findings(moves(BEYOND), DEFAULT)] == [0]
    assert workspace_findings([], DEFAULT) == []
