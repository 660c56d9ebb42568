"""Check of a program's timing: re-timed apps, pauses left out, and a speed factor out of its range."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from caesura_protocol.messages import LEAST_SPEED, MOST_SPEED
from caesura_protocol.number_words import fixed
from caesura_protocol.programs.checks.findings import Finding
from caesura_protocol.programs.document_timing import ProgramTiming, ShorterPause

NAMED = 5  # pauses in a finding, the longest ones


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
        yield _left_out(timing.shorter_pauses)


def _left_out(shorter: Sequence[ShorterPause]) -> Finding:
    """Return the finding on pauses that became shorter, at least one: it names the longest `NAMED`."""
    longest = sorted(shorter, key=lambda one: one.taught_s - one.seconds)[-NAMED:]
    pauses = ", ".join(
        f"{fixed(one.taught_s, 1)} s before app {one.app + 1}"
        + (f" ({fixed(one.seconds, 1)} s now)" if one.seconds > 0.0 else "")
        for one in shorter
        if one in longest
    )
    rest = len(shorter) - len(longest)
    more = f" and {rest} shorter ones" if rest else ""
    keeps = f"to keep one: --keep-pause {longest[-1].app + 1}"
    reason = f"taught pauses are left out: {pauses}{more}; {keeps}"
    return Finding("warning", None, None, reason, longest[-1].taught_s, longest[-1].seconds)
