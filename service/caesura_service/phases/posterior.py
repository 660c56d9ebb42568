"""The exact posterior over all ways to group segments into phases. Rabiner 1989; Fearnhead 2006.

With a_t(s) the probability of the segments up to t and of state s there, T and e as in `model.Chain`:

    a_t(s) = e_t(s) Σ_r a_{t−1}(r) T_t(r, s),    b_t(r) = Σ_s T_{t+1}(r, s) e_{t+1}(s) b_{t+1}(s)

a_t(s) b_t(s), normalised, is the probability of state s at segment t; of a state of age 1, that a phase of
its kind starts there. The same recursion with maximum gives the best grouping (Viterbi). Only ratios count,
so both are scaled at every segment.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from caesura_service.phases.model import Array, Chain, SegmentFeatures

ALIVE = 1e-3  # a state that is less probable after a settled segment is dropped


@dataclass(frozen=True)
class ForwardStep:
    """The state probabilities and the best paths after a segment, given the segments up to it.

    share: (states,) probability of each state. log_best: (states,) of the best path into it. come_from:
    (states,) the state before on that path. emission, resumed, ends: (states,) as the chain has them for it.
    moves: as the segment does.
    """

    share: Array
    log_best: Array
    come_from: NDArray[np.intp]
    emission: Array
    resumed: Array
    ends: Array
    moves: bool


def first_step(chain: Chain, segment: SegmentFeatures) -> ForwardStep:
    """Return the forward step of the first segment."""
    emission = chain.emission(segment)
    share = chain.first * emission
    with np.errstate(divide="ignore"):
        log_best = np.log(share)
    return ForwardStep(
        share=share / share.sum(),
        log_best=log_best - log_best.max(),
        come_from=np.full(share.size, -1),
        emission=emission,
        resumed=np.ones(share.size),
        ends=chain.ends(segment),
        moves=segment.moves,
    )


def next_step(
    chain: Chain, last: ForwardStep, segment: SegmentFeatures, before: Sequence[SegmentFeatures]
) -> ForwardStep:
    """Return the forward step of one more segment; before: those before it, the last one last."""
    emission, resumed, moves = chain.emission(segment), chain.resumed(segment, before), int(segment.moves)
    goes_on, begins = last.share @ chain.goes_on, (last.share * last.ends) @ chain.switches[moves]
    share = emission * (goes_on + begins + (last.share * resumed) @ chain.resumes)
    paths = last.log_best + chain.log_next_into[moves]
    for entries, weights in ((chain.switching, last.ends), (chain.resuming, resumed)):
        paths[entries] += np.log(weights)[entries[1]]
    come_from = paths.argmax(axis=1)
    log_best = paths[chain.states, come_from] + np.log(emission)
    return ForwardStep(
        share=share / share.sum(),
        log_best=log_best - log_best.max(),
        come_from=come_from,
        emission=emission,
        resumed=resumed,
        ends=chain.ends(segment),
        moves=segment.moves,
    )


def settled(step: ForwardStep) -> ForwardStep:
    """Return the step without the states of negligible probability: no later segment can make them likely."""
    alive = step.share >= ALIVE
    share = np.where(alive, step.share, 0.0)
    return replace(step, share=share / share.sum(), log_best=np.where(alive, step.log_best, -np.inf))


def posterior(chain: Chain, steps: Sequence[ForwardStep], *, ended: bool) -> list[Array]:
    """Return (states,) the probability of each state at each segment, given all of them.

    ended: the last segment is the demonstration's last.
    """
    ahead = chain.end * steps[-1].ends if ended else np.ones(chain.kind.size)
    found = []
    for step, before in zip(steps[::-1], [*steps[-2::-1], None], strict=True):
        joint = step.share * ahead
        found.append(joint / joint.sum())
        if before is not None:
            weighed = step.emission * ahead
            begins, resumes = chain.switches[int(step.moves)] @ weighed, chain.resumes @ weighed
            ahead = chain.goes_on @ weighed + before.ends * begins + step.resumed * resumes
            ahead = ahead / ahead.max()
    return found[::-1]


def best_last(chain: Chain, step: ForwardStep, *, ended: bool) -> int:
    """Return the state of the last segment on the best path; ended: as for `posterior`."""
    with np.errstate(divide="ignore"):
        return int(np.argmax(step.log_best + (np.log(chain.end * step.ends) if ended else 0.0)))


def best_states(steps: Sequence[ForwardStep], last: int) -> list[int]:
    """Return the state of each segment on the best path to a state of the last one."""
    path = [last]
    for step in steps[:0:-1]:
        path.append(int(step.come_from[path[-1]]))
    return path[::-1]


def decided(steps: Sequence[ForwardStep]) -> tuple[int, int]:
    """Return the last segment up to which all best paths agree, and its state; (-1, -1) for none.

    It is the last segment at which all states that are possible after the last step have one ancestor.
    """
    states = set(np.flatnonzero(np.isfinite(steps[-1].log_best)).tolist())
    for index in range(len(steps) - 1, 0, -1):
        if len(states) == 1:
            return index, states.pop()
        states = {int(steps[index].come_from[state]) for state in states}
    return (0, states.pop()) if len(states) == 1 else (-1, -1)
