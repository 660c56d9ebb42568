"""The window: the evidence of its segments, the sums after a condition, and smoothing.

`changepoint.evidence_window.Window` computes the backward pass on log evidence; this module computes it on
probabilities. A segment of group j that starts at u follows one of group i with probability E_i(u) R_ij /
A_j(u) (`window_flow`). That one began at s with probability A_i(s) g(u−s) L_i(s,u−1) / E_i(u)
(`window_shares`). Both are constant from then on. So the probability that a segment of group i starts at s is
that of the last segment, plus, for every later start u, that of u times flow and share. Only the last
segment's exponentials are computed at each step.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

import math

from caesura_service.changepoint.kernels.array_tuple import model_at, state_at
from caesura_service.changepoint.kernels.fast_math import exponentials, log_sum_exp, shares_of
from caesura_service.changepoint.kernels.layout import FREE
from caesura_service.changepoint.kernels.path_nodes import new_node, node_at, node_made, refer, release
from caesura_service.numba_support.decorators import compiled


@compiled
def remember(ctx):
    """Compute `Window.remember`, before the observation is counted."""
    state = state_at(ctx)
    me = state.counters[0]
    now, size = me.count, state.window_evidence.shape[0]
    row = now % size
    evidence, plain, starts = state.window_evidence[row], state.window_plain[row], state.starts
    kinds = state.window_kinds[row]
    evidence[:] = -math.inf
    plain[:] = -math.inf
    remember_links(ctx, row)
    state.window_opens[row] = now == me.opening
    for place in range(me.living - 1, -1, -1):
        start = starts[place]
        if start <= now - size:
            break
        for group in range(evidence.shape[0]):
            if state.priors[0, group, place] > -math.inf:
                evidence[group, start % size] = state.evidence[group, place]
                plain[group, start % size] = state.plain[group, place]
        for k in range(kinds.shape[1]):
            kinds[start % size, k] = state.kinds[k, place]


@compiled
def remember_links(ctx, row):
    """Store the links of the next start in this row."""
    state = state_at(ctx)
    for group in range(state.next.shape[1]):
        for i in range(2):
            state.window_priors[i, group, row] = state.next[i, group]
            state.window_ended[i, group, row] = state.ended[i, group]
        state.window_before[group, row] = state.next_before[group]


@compiled
def keep_shares(ctx, start, group, starts, shares, n):
    """Store, for a group of segments that may have ended before `start`, the probability of each start."""
    state = state_at(ctx)
    size = state.window_shares.shape[0]
    row = state.window_shares[start % size, group]
    row[:] = 0.0
    for i in range(n - 1, -1, -1):
        if starts[i] <= start - size:
            break
        row[starts[i] % size] = shares[i]


@compiled
def link_next_start(ctx, start, free):
    """Compute the next start's links, as `changepoint.evidence_window.link`, from the segments before it."""
    model, state = model_at(ctx), state_at(ctx)
    ended, following, before = state.ended, state.next, state.next_before
    power = model.settings[0].power
    groups, row = ended.shape[1], start % state.window_evidence.shape[0]
    flow = state.window_flow[row]
    state.window_free[row] = free
    likeliest = 0
    for i in range(groups):
        if ended[1, i] > ended[1, likeliest]:
            likeliest = i
    before[groups] = likeliest
    for j in range(groups):
        best, chosen, peak = -math.inf, 0, -math.inf
        for i in range(groups):
            weight = 0.0 if free else model.transition[i, j]
            flow[i, j] = ended[0, i] + power * weight
            peak = max(peak, flow[i, j])
            if ended[1, i] + weight > best:
                best, chosen = ended[1, i] + weight, i
        following[1, j], before[j] = best, chosen
        total = 0.0
        for i in range(groups):
            flow[i, j] = math.exp(flow[i, j] - peak) if peak > -math.inf else 0.0
            total += flow[i, j]
        following[0, j] = peak + math.log(total) if peak > -math.inf else peak
        for i in range(groups):
            flow[i, j] /= total if total > 0.0 else 1.0


@compiled
def smooth(ctx):
    """Compute `Window.smoothed` of each observation in the window, from the living hypotheses' joints."""
    model, state = model_at(ctx), state_at(ctx)
    me, begun, terms = state.counters[0], state.begun, state.terms
    size, groups = state.window_evidence.shape[0], begun.shape[0]
    now, span = me.count - 1, min(me.count, size)
    evidence, priors = state.window_evidence[now % size], state.window_priors[0]
    power = model.settings[0].power
    for place in range(me.living):
        terms[place] = state.joint[place]
    total = log_sum_exp(terms, me.living)
    for group in range(groups):
        row = now % size
        for age in range(span):
            survived = power * model.log_survival[state.window_opens[row], age]
            begun[group, row] = priors[group, row] + survived + evidence[group, row]
            row = row - 1 if row else size - 1
        exponentials(begun[group], total, begun.shape[1])
    row = now % size
    for i in range(span - 1, -1, -1):
        probability, flow = 0.0, state.window_flow[row]
        for group in range(groups):
            probability += begun[group, row]
        state.smoothed[i] = min(probability, 1.0)
        if probability > 0.0:
            for before in range(groups):
                through = 0.0
                for group in range(groups):
                    through += begun[group, row] * flow[before, group]
                pass_back_probability(begun[before], state.window_shares[row, before], through)
        row = row - 1 if row else size - 1


@compiled
def pass_back_probability(begun, shares, probability):
    """Pass the probability of a start on to the starts of the segment before it, by their shares."""
    for s in range(begun.size):
        begun[s] += probability * shares[s]


@compiled
def sum_from(ctx, start, before):
    """Compute `Window.sum_from`, and make the nodes of the starts after it."""
    state = state_at(ctx)
    me, size = state.counters[0], state.window_evidence.shape[0]
    for end in range(start, me.count):
        for earlier in range(max(0, me.count - size), start):
            state.window_evidence[end % size, :, earlier % size] = -math.inf
            state.window_plain[end % size, :, earlier % size] = -math.inf
    begin_anew(ctx, start, before)
    for end in range(start + 1, me.count + 1):
        for group in range(state.begun.shape[0]):
            end_anew(ctx, start, end, group)
        free = end < me.count and state.window_free[end % size] == 1
        link_next_start(ctx, end, free)
        nodes_anew(ctx, start, end)
        if end < me.count:
            remember_links(ctx, end % size)
    refer_anew(ctx, start)


@compiled
def begin_anew(ctx, start, before):
    """Make the nodes of the start again; with `before` known, every group descends from that one."""
    model, state = model_at(ctx), state_at(ctx)
    row, groups = start % state.window_evidence.shape[0], state.begun.shape[0]
    for group in range(groups):
        if before != FREE:
            weight = 0.0 if state.window_free[row] else model.transition[before, group]
            state.window_priors[1, group, row] = state.window_ended[1, before, row] + weight
            state.window_before[group, row] = before
        state.anew[0, group] = node_at(ctx, start, state.window_before[group, row])


@compiled
def end_anew(ctx, start, end, group):
    """Sum again over the segmentations from `start` on that end before `end` with a segment of this group."""
    model, state = model_at(ctx), state_at(ctx)
    power = model.settings[0].power
    size, priors, terms, starts = (
        state.window_evidence.shape[0],
        state.window_priors,
        state.terms,
        state.counted,
    )
    row = (end - 1) % size
    best, chosen, evidence, plain = (
        -math.inf,
        start,
        state.window_evidence[row, group],
        state.window_plain[row, group],
    )
    for s in range(start, end):
        mass = model.log_mass[state.window_opens[s % size], end - s]
        terms[s - start] = priors[0, group, s % size] + (power * mass + evidence[s % size])
        score = priors[1, group, s % size] + (mass + plain[s % size])
        if score > best:
            best, chosen = score, s
        starts[s - start] = s
    state.ended[1, group], state.ended_at[group] = best, chosen
    state.ended[0, group] = shares_of(terms, end - start)
    keep_shares(ctx, end, group, starts, terms, end - start)


@compiled
def nodes_anew(ctx, start, end):
    """Make the nodes of a later start, to `state.anew`: one for each group with a descendant."""
    state = state_at(ctx)
    size, nodes = state.window_evidence.shape[0], state.anew[end - start]
    for i in range(nodes.size):
        before, node = state.next_before[i], node_made(ctx, nodes, i)
        if i < nodes.size - 1 and state.next[1, i] == -math.inf:
            nodes[i] = FREE
        elif node != FREE:
            nodes[i] = refer(ctx, node)
        else:
            at = state.ended_at[before]
            kinds = state.window_kinds[(end - 1) % size, at % size]
            nodes[i] = new_node(ctx, end, state.anew[at - start, before], before, kinds)


@compiled
def refer_anew(ctx, start):
    """Let hypotheses from `start` on, and the next one, refer to the new nodes."""
    state = state_at(ctx)
    me, anew, groups, size = (
        state.counters[0],
        state.anew,
        state.begun.shape[0],
        state.window_evidence.shape[0],
    )
    for place in range(me.living):
        at = state.starts[place] - start
        if at >= 0:
            for group in range(groups):
                possible = state.window_priors[1, group, state.starts[place] % size] > -math.inf
                node = refer(ctx, anew[at, group] if possible else FREE)
                release(ctx, state.nodes[group, place])
                state.nodes[group, place] = node
    for i in range(groups + 1):
        node = refer(ctx, anew[me.count - start, i])
        release(ctx, state.next_nodes[i])
        state.next_nodes[i] = node
    for end in range(me.count, start, -1):
        for i in range(groups + 1):
            release(ctx, anew[end - start, i])
