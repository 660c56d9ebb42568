"""Is every target inside of the workspace that the limits of the cell state?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from caesura_protocol.messages import App, Vector
from caesura_protocol.plausibility import likely_length_unit
from caesura_protocol.programs.checks.findings import Finding
from caesura_protocol.programs.safety import Safety

EDGE_M = 0.01  # from the edge of the workspace


def workspace_findings(apps: Sequence[App], safety: Safety) -> list[Finding]:
    """Find targets of the flange that are outside of the workspace, or at its edge."""
    return [
        Finding("error", index, app.kind, reason)
        for index, app in enumerate(apps)
        for reason in reasons_outside(app.target, safety)
    ]


def reasons_outside(target: Vector | None, safety: Safety) -> Iterator[str]:
    """Yield the axes on which a target [m] is outside of the workspace, with the limits."""
    if target is None:
        return
    likely = likely_length_unit(target)
    guess = "" if likely is None else f": it is probably in {likely}"
    for axis, value, least, most in zip(
        "xyz", target, safety.workspace_low, safety.workspace_high, strict=True
    ):
        if not least + EDGE_M <= value <= most - EDGE_M:
            limits = f"{least:g} to {most:g} m"
            yield f"target {axis} {value:.3f} m is outside of the workspace, {limits}{guess}"
