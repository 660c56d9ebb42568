"""The window: the evidence of its segments, what a start taken for certain sums anew, and smoothing.

`window.Window` goes back over the evidence in logarithms. Here it is done with probabilities: what ends
before u began at s with probability A(s) g(u−s) L(s,u−1) / A(u), which never changes any more. So a segment
starts at s with the probability that the last one did, and for every start u after it with the probability of
u times that of its forerunner having begun at s. Only the last segment's exponentials have to be taken anew.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

import math

from caesura_service.changepoint.kernels.elementary import exponentials, log_sum_exp, shares_of
from caesura_service.changepoint.kernels.nodes import new_node, node_at, release
from caesura_service.changepoint.kernels.unpacking import model_at, state_at
from caesura_service.compiling.decorators import compiled


@compiled
def remember(here):
    """`Window.remember`, before the observation is counted."""
    state = state_at(here)
    me = state.counters[0]
    now, size = me.count, state.window_evidence.shape[0]
    row = now % size
    evidence, kinds, starts = state.window_evidence[row], state.window_kinds[row], state.starts
    evidence[:] = -math.inf
    state.window_priors[0, row], state.window_priors[1, row] = me.next_prior, me.next_map
    for place in range(me.living - 1, -1, -1):
        start = starts[place]
        if start <= now - size:
            break
        evidence[start % size] = state.evidence[place]
        for k in range(kinds.shape[1]):
            kinds[start % size, k] = state.kinds[k, place]


@compiled
def keep_shares(here, start, starts, shares, n):
    """Of the segments that may have ended before `start`, the probability that they began at `starts`."""
    state = state_at(here)
    size = state.window_shares.shape[0]
    row = state.window_shares[start % size]
    row[:] = 0.0
    for i in range(n - 1, -1, -1):
        if starts[i] <= start - size:
            break
        row[starts[i] % size] = shares[i]


@compiled
def smooth(here):
    """`Window.smoothed`, given the joints of the living."""
    model, state = model_at(here), state_at(here)
    me, begun, terms = state.counters[0], state.begun, state.terms
    size = state.window_evidence.shape[0]
    now, span = me.count - 1, min(me.count, size)
    evidence, priors = state.window_evidence[now % size], state.window_priors[0]
    for place in range(me.living):
        terms[place] = state.joint[place]
    total = log_sum_exp(terms, me.living)
    row = now % size
    for age in range(span):
        begun[row] = priors[row] + model.log_survival[age] + evidence[row]
        row = row - 1 if row else size - 1
    exponentials(begun, total, begun.size)
    row = now % size
    for i in range(span - 1, -1, -1):
        probability = begun[row]
        state.smoothed[i] = min(probability, 1.0)
        go_back(begun, state.window_shares[row], probability)
        row = row - 1 if row else size - 1


@compiled
def go_back(begun, shares, probability):
    """From a start to those of the segment before it."""
    for s in range(begun.size):
        begun[s] += probability * shares[s]


@compiled
def sum_from(here, start):
    """`Window.sum_from`, and the nodes that follow from it."""
    model, state = model_at(here), state_at(here)
    me, terms = state.counters[0], state.terms
    size, priors = state.window_evidence.shape[0], state.window_priors
    for end in range(start, me.count):
        for before in range(max(0, me.count - size), start):
            state.window_evidence[end % size, before % size] = -math.inf
    anew, starts = state.anew, state.counted  # nodes of start, start + 1, …
    anew[0] = node_at(here, start)
    for end in range(start + 1, me.count + 1):
        best, chosen, evidence = -math.inf, start, state.window_evidence[(end - 1) % size]
        for s in range(start, end):
            mass = model.log_mass[end - s] + evidence[s % size]
            terms[s - start] = priors[0, s % size] + mass
            score = priors[1, s % size] + mass
            if score > best:
                best, chosen = score, s
            starts[s - start] = s
        total = shares_of(terms, end - start)
        keep_shares(here, end, starts, terms, end - start)
        kinds = state.window_kinds[(end - 1) % size, chosen % size]
        anew[end - start] = new_node(here, end, anew[chosen - start], kinds)
        if end < me.count:
            priors[0, end % size], priors[1, end % size] = total, best
        else:
            me.next_prior, me.next_map = total, best
    refer_anew(here, start)


@compiled
def refer_anew(here, start):
    """Hypotheses behind `start`, and the next one, go over to the nodes that were made anew."""
    state = state_at(here)
    me, anew = state.counters[0], state.anew
    for place in range(me.living):
        if state.starts[place] > start:
            before, state.nodes[place] = state.nodes[place], anew[state.starts[place] - start]
            state.node_references[state.nodes[place]] += 1
            release(here, before)
    before, me.next = me.next, anew[me.count - start]
    state.node_references[me.next] += 1
    release(here, before)
    for end in range(me.count, start, -1):
        release(here, anew[end - start])
