"""Hints from the posterior: a boundary with a probability near one half.

The models of segments look five observations ahead at a corner that takes 0.3 s: then its weight does not
change any more (`changepoint.corner_weight`). After that the smoothed probability that a boundary is near is
mostly below 0.1 or above 0.9. In between, the demonstration does not show whether a segment ends there. For a
slower corner the weight settles after seven. Waiting for it does not reduce false hints. A hint needs two
observations in a row at which a boundary is unclear, because most resolve with the second.

Where the arm rests for as long as the advice says, the advice has been followed: a boundary in such a rest
has no hint.

A boundary has one hint. At first its advice is to pause. If the boundary is still unclear when it leaves the
window of the posterior, a pause comes too late: the same hint then advises demonstrating the part again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import takewhile
from typing import NamedTuple, Protocol

from caesura_protocol.messages import Hint, HintKind
from caesura_service.coaching.hint_log import HintLog

LAG = 5  # observations after a boundary at which it is judged: the look-ahead at a corner of 0.3 s
REACH = 3  # observations to either side at which the same boundary may lie
UNSURE, SURE = 1.0 / 3.0, 2.0 / 3.0  # odds of two to one, either way
RESOLVED = 0.8  # probability for or against it, above which the hint is cleared
WINDOW = 40  # observations, after which a boundary's probability does not change
LEAST = 20  # observations for which a hint stays, so that it can be read
PAUSED = 5  # steps between observations in which the arm rests, for a rest to be the pause that is advised
SHOWN = 100  # observations for which a part that is to be shown again is hinted at
KIND: HintKind = "uncertain_boundary"
PAUSE = "Pause here for half a second."


class Boundary(NamedTuple):
    """A possible boundary under observation."""

    start: int  # observation at which a segment would start
    t: float  # [s]
    after: float  # [s] the last sure boundary before it


class SmoothedPosterior(Protocol):
    """The members of a changepoint filter that hints on boundaries use."""

    @property
    def count(self) -> int:
        """The number of observations so far."""

    def changepoint_probabilities(self, first: int, last: int, *, about: int | None = None) -> list[float]:
        """Return the smoothed probability of a start at each observation from the first to the last."""


class BoundaryCoach:
    """Follows the posterior of one filter, observation by observation."""

    def __init__(self) -> None:
        self.log = HintLog()
        self._candidate: Boundary | None = None  # was unclear at the observation before
        self._open: list[Boundary] = []  # that were unclear, and are neither resolved nor out of the window
        self._hinted: Boundary | None = None  # the last one for which a hint was raised
        self._again: Boundary | None = None  # whose part is to be shown again
        self._sure: float | None = None  # [s] the newest sure boundary
        self._again_until = 0  # observation
        self._rests: tuple[bool, ...] = ()  # whether the arm rests in the newest steps

    def observe(
        self, posterior: SmoothedPosterior, t: float, places: Sequence[float], *, rests: bool = False
    ) -> None:
        """Process the posterior after an observation at t [s].

        places: where a segment would start [s]; rests: the arm has not moved since the observation before.
        """
        self._rests = (*self._rests, rests)[-LAG - PAUSED :]
        newest = posterior.count - 1
        if newest >= self._again_until:
            self._clear_again(t)
        index = newest - LAG
        if index < REACH:
            return
        candidate, self._candidate = self._candidate, None
        if candidate is not None:
            again = sum(posterior.changepoint_probabilities(candidate.start - REACH, candidate.start + REACH))
            if UNSURE < again <= SURE:
                self._watch(candidate, t, again)
        near = posterior.changepoint_probabilities(index - REACH, index + REACH)
        found = sum(near)
        if near[REACH] == max(near) and found > UNSURE:
            if found > SURE:
                self._sure = places[index]
            elif self._may_hint(index) and not self._is_in_pause():
                after = places[0] if self._sure is None else self._sure
                self._candidate = Boundary(index, places[index], after)
        for boundary in [*self._open]:
            self._follow(posterior.changepoint_probabilities, boundary, newest, t)

    def _may_hint(self, index: int) -> bool:
        """Whether a boundary is more than LEAST observations after the last hinted one."""
        return self._hinted is None or index > self._hinted.start + LEAST

    def _is_in_pause(self) -> bool:
        """Whether the arm rests for the advised pause around the observed boundary."""
        before, after = self._rests[: -LAG - 1], self._rests[-LAG - 1 :]  # the first leads to the boundary
        rest = [*takewhile(bool, after)]
        if rest:
            rest += takewhile(bool, reversed(before))
        return len(rest) >= PAUSED

    def _watch(self, boundary: Boundary, t: float, probability: float) -> None:
        """Raise a hint for a boundary, and start observing it."""
        self._hinted = boundary
        self._open.append(boundary)
        text = f"Unclear whether a segment ends at {boundary.t:.1f} s (probability {probability:.2f})."
        self.log.raise_hint(
            Hint(kind=KIND, since=t, text=text, advice=PAUSE, t0=boundary.t, tn=boundary.t), boundary.t
        )

    def _follow(
        self, probabilities: Callable[[int, int], list[float]], boundary: Boundary, newest: int, t: float
    ) -> None:
        """Clear the hint once the boundary is resolved; change its advice if it leaves the window unclear."""
        found = sum(probabilities(boundary.start - REACH, boundary.start + REACH))
        is_resolved = not 1.0 - RESOLVED < found < RESOLVED
        age = newest - boundary.start
        if age < LAG + LEAST or (not is_resolved and age < WINDOW):
            return
        self._open.remove(boundary)
        if not UNSURE < found <= SURE:
            self.log.clear(KIND, t, place=boundary.t)
            return
        self._clear_again(t)
        self._again, self._again_until = boundary, newest + SHOWN
        until = t if self._sure is None or self._sure <= boundary.t else self._sure
        text = f"The boundary at {boundary.t:.1f} s stayed unclear."
        advice = f"Teach the part from {boundary.after:.1f} to {until:.1f} s again."
        self.log.update_hint(
            KIND, boundary.t, {"text": text, "advice": advice, "t0": boundary.after, "tn": until}
        )

    def _clear_again(self, t: float) -> None:
        """Clear the hint that asks to demonstrate a part again, if there is one."""
        if self._again is not None:
            self.log.clear(KIND, t, place=self._again.t)
            self._again = None
