"""Check of a program's timing: re-timed apps, pauses left out, and a speed factor out of its range."""

from __future__ import annotations

from collections.abc import Iterator

from caesura_protocol.messages import LEAST_SPEED, MOST_SPEED
from caesura_protocol.number_words import fixed
from caesura_protocol.programs.checks.findings import Finding
from caesura_protocol.programs.document_timing import ProgramTiming


def timing_findings(timing: ProgramTiming | None) -> Iterator[Finding]:
    """Yield a warning on re-timed apps and one on shorter pauses, or an error for a factor out of its range.

    None: the times are as taught, without a finding.
    """
    if timing is None:
        return
    if not timing.is_sane:
        reason = (
            f"speed {timing.speed:g}, expected optimal or a factor from {LEAST_SPEED:g} to {MOST_SPEED:g}"
        )
        limit = LEAST_SPEED if float(timing.speed) < LEAST_SPEED else MOST_SPEED
        yield Finding("error", None, None, reason, float(timing.speed), limit)
        return
    apps = ", ".join(str(index + 1) for index in timing.retimed) or "none"
    durations = f"{fixed(timing.taught_s, 2)} s taught, {fixed(timing.seconds, 2)} s now"
    yield Finding("warning", None, None, f"re-timed (speed {timing.speed}): apps {apps}; {durations}")
    if timing.shorter_pauses:
        pauses = ", ".join(
            f"{fixed(one.taught_s, 1)} s before app {one.app + 1}"
            + (f" ({fixed(one.seconds, 1)} s now)" if one.seconds > 0.0 else "")
            for one in timing.shorter_pauses
        )
        longest = max(timing.shorter_pauses, key=lambda one: one.taught_s)
        reason = f"pauses that were taught are left out: {pauses}; --keep-pause {longest.app + 1} keeps one"
        yield Finding("warning", None, None, reason, longest.taught_s, longest.seconds)
