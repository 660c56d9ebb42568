"""Samples of a recording that were lost on the way: the times beside them, as a file states them.

A loss has the times [s] of the samples before and after it. Before the first sample and after the last one,
both are the time of that sample, as in `messages.Gap`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.number_words import counted, interval

Array = NDArray[np.float64]
Loss = tuple[float, float]
NAMED = 5  # losses in a sentence
TO = " to "


def losses_of(ends: Mapping[int, Loss], last: int | None = None) -> tuple[Loss, ...]:
    """Return the losses between batches, in order.

    ends: times [s] of the first and the last sample of each batch, by its number; last: number of the last
    batch that was sent, None if it is not known.
    """
    seqs = sorted(ends)
    if not seqs:
        return ()
    begins, ended = ends[seqs[0]][0], ends[seqs[-1]][1]
    found = [(begins, begins)] if seqs[0] > 0 else []
    for before, after in pairwise(seqs):
        if after > before + 1:
            t0, tn = ends[before][1], ends[after][0]
            found.append((t0, max(tn, math.nextafter(t0, math.inf))))  # a clock may have been set meanwhile
    if last is not None and last > seqs[-1]:
        found.append((ended, ended))
    return tuple(found)


def rows_after_losses(t: Array, lost: Sequence[Loss]) -> list[int]:
    """Return the number of the first sample after each loss; that of all samples for a loss after them.

    t: (n,) [s], in the order of arrival.
    """
    newest = np.maximum.accumulate(t)
    rows = [int(np.searchsorted(newest, tn)) if t0 < tn else 0 if t0 <= t[0] else t.size for t0, tn in lost]
    return sorted(set(rows))


def losses_text(lost: Sequence[Loss]) -> str:
    """Return losses as a file states them.

    >>> losses_text([(3.99, 4.2), (8.0, 8.0)])
    '3.99 to 4.2, 8.0 to 8.0'
    """
    return ", ".join(TO.join(map(repr, loss)) for loss in lost)


def parse_losses(text: str) -> tuple[Loss, ...]:
    """Return the losses that a file states. Raises ValueError with the expected content."""
    found = []
    for loss in text.split(","):
        try:
            t0, tn = map(float, loss.split(TO))
        except ValueError:
            t0, tn = math.nan, math.nan
        if not -math.inf < t0 <= tn < math.inf:
            raise ValueError(f"lost is {text!r:.100}, expected times [s] such as '3.99 to 4.2, 8.0 to 8.5'")
        found.append((t0, tn))
    return tuple(found)


def losses_in_words(lost: Sequence[Loss]) -> str:
    """Return a sentence on losses, the longest ones with their times.

    >>> losses_in_words([(1.0, 1.0), (3.99, 4.2)])
    'Samples were lost at 3.99–4.20 s, at 1.00 s: what was taught then is missing.'
    """
    longest = sorted(lost, key=lambda loss: loss[0] - loss[1])
    named = ", ".join(f"at {interval(*loss, 2)} s" for loss in longest[:NAMED])
    rest = len(longest) - NAMED
    more = f" and at {counted(rest, 'other place')}" if rest > 0 else ""
    return f"Samples were lost {named}{more}: what was taught then is missing."
