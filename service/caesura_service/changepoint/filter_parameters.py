"""The bounds on the work of a filter, and its threshold for a certain changepoint."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FilterParameters:
    """The bounds on the work of a filter, and its threshold for a certain changepoint.

    Hypotheses below `prune_ratio` relative to the best are dropped (thesis (2.34), with the inequality
    corrected). The `keep_youngest` never are, because they have too few samples to be judged: a movement that
    has just begun fits no profile yet, and two seconds are one movement. At most `cap` live. `window`: number
    of past samples over which changepoints are smoothed.

    A changepoint of the best segmentation is certain when its smoothed probability, that of its neighbours
    included, passes `certain` with `certain_after` samples seen since it; 1 leaves all to coalescence. The
    posterior is overconfident while the following movement fits no profile yet. Of changepoints that pass
    0.99 with 0.3 s seen since (simulated teacher), 6 % vanish later and 33 % move by a sample. With 1.5 s
    seen since, these are 0.4 % and 8 %.
    """

    prune_ratio: float = 1e-6
    keep_youngest: int = 20
    cap: int = 100
    window: int = 40
    certain: float = 0.99
    certain_after: int = 15

    def __post_init__(self) -> None:
        if not 0 <= self.keep_youngest < self.cap:
            raise ValueError(f"keep_youngest is {self.keep_youngest}, expected 0 to cap − 1 = {self.cap - 1}")
        if not 0.0 <= self.prune_ratio < 1.0:
            raise ValueError(f"prune_ratio is {self.prune_ratio}, expected 0 ≤ ratio < 1")
        if self.window < 1:
            raise ValueError(f"window is {self.window} samples, expected at least 1")
        if not 0.5 < self.certain <= 1.0:
            raise ValueError(f"certain is {self.certain}, expected a probability above 0.5")
        if self.certain_after < 0:
            raise ValueError(f"certain_after is {self.certain_after} samples, expected at least 0")
