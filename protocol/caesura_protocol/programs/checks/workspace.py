"""Checks that every target is inside the workspace stated by the cell's limits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from caesura_protocol.messages import App, Vector
from caesura_protocol.plausibility import likely_length_unit
from caesura_protocol.programs.checks.findings import Finding, Remedy, in_mm
from caesura_protocol.programs.safety import Safety

_IN_ANOTHER_FRAME = ". Were they stated in another base frame? If not, "
STATE_WORKSPACE = Remedy(
    f"{_IN_ANOTHER_FRAME}state the workspace of the cell with --cell",
    f"{_IN_ANOTHER_FRAME}the workspace of the cell is another: state it where the program is run",
)
EDGE_M = 0.01  # from the edge of the workspace
NEARLY_ALL, OF_AT_LEAST = 0.8, 2  # share of the targets outside, and targets, of which the frame is doubtful


def workspace_findings(apps: Sequence[App], safety: Safety) -> list[Finding]:
    """Return the targets of the flange that are outside of the workspace, or at its edge.

    There is one finding per app, or one for the program if nearly all of its targets are outside.
    """
    placed = [(index, app, app.target) for index, app in enumerate(apps) if app.target is not None]
    outside = [(index, app, reason) for index, app, at in placed if (reason := outside_reason(at, safety))]
    if len(outside) >= OF_AT_LEAST and len(outside) >= NEARLY_ALL * len(placed):
        first = outside[0][0]
        return [_in_another_frame(len(outside), len(placed), first, apps[first].target, safety)]
    return [Finding("error", index, app.kind, reason) for index, app, reason in outside]


def outside_reason(target: Vector | None, safety: Safety) -> str | None:
    """Return the axes on which a target [m] is outside of the workspace, with the limits; None: on none."""
    if target is None:
        return None
    likely = likely_length_unit(target)
    stated = _metres if likely else _millimetres  # as in other texts, where nothing is wrong with the unit
    beyond = [
        stated(axis, value, least, most)
        for axis, value, (least, most) in zip("xyz", target, _sides(safety), strict=True)
        if not least + EDGE_M <= value <= most - EDGE_M
    ]
    if not beyond:
        return None
    guess = "" if likely is None else f": it is probably in {likely}"
    (first, limits), *others = beyond
    more = "".join(f"; {place}{its_limits}" for place, its_limits in others)
    return f"target {first} is outside of the workspace{limits}{more}{guess}"


def _millimetres(axis: str, value: float, least: float, most: float) -> tuple[str, str]:
    return f"{axis} {1000 * value:.0f} mm", f", {1000 * least:.0f} to {1000 * most:.0f} mm"


def _metres(axis: str, value: float, least: float, most: float) -> tuple[str, str]:
    return f"{axis} {value:.3f} m", f", {least:g} to {most:g} m"


def _sides(safety: Safety) -> Iterator[tuple[float, float]]:
    return zip(safety.workspace_low, safety.workspace_high, strict=True)


def _in_another_frame(count: int, placed: int, first: int, target: Vector | None, safety: Safety) -> Finding:
    """Return the finding if nearly all targets are outside; target: of app `first`."""
    assert target is not None, "it is outside"
    box = ", ".join(
        f"{axis} {least:g} to {most:g} m" for axis, (least, most) in zip("xyz", _sides(safety), strict=True)
    )
    likely = likely_length_unit(target)
    reason = (
        f"{count} of {placed} targets are outside of the workspace, {box}, such as app {first + 1} at "
        f"{in_mm(target)}"
    )
    found = Finding("error", None, None, reason)
    return (
        STATE_WORKSPACE.of(found)
        if likely is None
        else replace(found, reason=f"{reason}. They are probably in {likely}")
    )
