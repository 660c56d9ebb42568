"""The gaps of a demonstration, and their effect on a task program.

Principle: an app's confidence is that of its segments, times the share of its time that was observed. Its
time includes every gap in it or at its edge: there the app ends because observations are missing. A gap
between two apps counts for both. So a program with a gap states it in the confidence of each app, and in a
note that lists the gaps.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from itertools import takewhile

from caesura_protocol.messages import Gap
from caesura_protocol.number_words import fixed, interval

EDGE_S = 0.2  # conditioning makes no observation this close to a gap, so an app may end as long before it
NAMED = 5  # gaps in a note, the longest ones
NOT_OBSERVED = "Not observed: "  # begins the note
REASONS = {"source": "the source paused", "evicted": "samples were lost"}


def observed_share(t0: float, tn: float, gaps: Sequence[Gap]) -> float:
    """Return the share [0, 1] of the time of an app, from t0 to tn [s], that was observed.

    A gap at an edge of the app counts fully. gaps: in time order, without overlaps.
    """
    first = bisect_left(gaps, t0 - EDGE_S, key=lambda gap: gap.tn)
    beside = list(takewhile(lambda gap: gap.t0 <= tn + EDGE_S, gaps[first:]))
    if t0 == tn:
        beside = [gap for gap in beside if gap.t0 < t0 < gap.tn]  # an instant has no edge
    lost = sum(gap.tn - gap.t0 for gap in beside)
    inside = sum(max(min(gap.tn, tn) - max(gap.t0, t0), 0.0) for gap in beside)
    seen = max(tn - t0 - inside, 0.0)
    return seen / (seen + lost) if lost > 0.0 else 1.0


class Gaps:
    """The gaps of a demonstration in time order. A further one costs a copy, however many there are."""

    def __init__(self) -> None:
        self.all: tuple[Gap, ...] = ()
        self._longest: list[Gap] = []
        self._total_s = 0.0

    def add(self, gap: Gap) -> None:
        """Add a gap that is later than all before it."""
        self.all = (*self.all, gap)
        self._longest = sorted([*self._longest, gap], key=lambda one: one.t0 - one.tn)[:NAMED]
        self._total_s += gap.tn - gap.t0

    def note(self, began: float) -> str:
        """Return the note on gaps for the operator who runs the program; began [s]: its first sample."""
        named = ", ".join(_named(gap, began) for gap in sorted(self._longest, key=lambda one: one.t0))
        rest = len(self.all) - len(self._longest)
        more = f" and {rest} shorter ones, {fixed(self._total_s, 2)} s in all" if rest else ""
        unsure = ", and apps beside it are less sure" if self._total_s > 0.0 else "; how much is not known"
        return f"{NOT_OBSERVED}{named}{more}. What was taught then is missing{unsure}."


def _named(gap: Gap, began: float) -> str:
    if gap.t0 < gap.tn:
        when = f"{interval(gap.t0, gap.tn, 2)} s"
    else:
        when = f"{'before' if gap.t0 <= began else 'after'} {fixed(gap.t0, 2)} s"
    return f"{when} ({REASONS[gap.reason]})"
