"""One step of the filter: implements `RunLengthFilter.step` and `RunLengthFilter.condition_on_start`."""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

import math

from caesura_service.changepoint.kernels.array_tuple import model_at, state_at
from caesura_service.changepoint.kernels.channels import update_channel
from caesura_service.changepoint.kernels.evidence_window import (
    keep_shares,
    link_next_start,
    remember,
    smooth,
    sum_from,
)
from caesura_service.changepoint.kernels.fast_math import exponentials, largest_of, logarithms, shares_of
from caesura_service.changepoint.kernels.layout import AXES, FORCE, FORCES, FREE, HOLDING, ROTATION
from caesura_service.changepoint.kernels.path_nodes import (
    copy_row,
    new_node,
    node_made,
    refer,
    release,
    settle_root,
)
from caesura_service.changepoint.kernels.residual_evidence import add_values, lanes_of
from caesura_service.numba_support.decorators import compiled

UNKNOWN = -1
REFUSED = -2


@compiled
def step(ctx, boundary, changepoint):
    """Process the observation `state.now`, all numbers of which except the last must be finite.

    ctx: address of the table of arrays. boundary: whether it follows a gap. changepoint: 1 or 0 if it is
    known whether a segment starts here, else UNKNOWN. There must be space for one more hypothesis and one
    more node, and the model's tables must be long enough.

    Returns the number of segments that became final, and the start that is certain now, -1 without one;
    REFUSED, with no change, if a value is not finite. `counters.left` is the smoothed probability of the
    observation that left the window.
    """
    state = state_at(ctx)
    me = state.counters[0]
    for i in range(HOLDING):
        if not math.isfinite(state.now[i]):
            return 0, REFUSED
    me.settled = 0
    if me.count and (boundary or changepoint == 1):
        link_next_start(ctx, me.count, True)
        take_likeliest(ctx)
    if boundary:
        while me.living:
            drop_hypothesis(ctx, me.living - 1)
    add_observation(ctx, changepoint)
    prepare_next(ctx)
    prune(ctx)
    settle_root(ctx)
    if me.count > state.smoothed.shape[0]:
        me.left = state.smoothed[0]
    smooth(ctx)
    return me.settled, latest_certain_start(ctx)


@compiled
def condition_on_start(ctx, start):
    """Condition on a segment that starts at `start`; needs space for a node per sample since."""
    state = state_at(ctx)
    me = state.counters[0]
    me.settled = 0
    before = group_before(ctx, start)
    keep_from(ctx, start, before)
    if before == FREE:  # now that the best segmentation has this start
        keep_from(ctx, start, group_before(ctx, start))
    settle_root(ctx)
    smooth(ctx)


@compiled
def keep_from(ctx, start, before):
    """Compute `RunLengthFilter._sum_from`, and the joint probabilities of the remaining hypotheses."""
    state = state_at(ctx)
    me = state.counters[0]
    sum_from(ctx, start, before)
    while me.living and state.starts[0] < start:
        drop_hypothesis(ctx, 0)
    for place in range(me.living):
        row = state.starts[place] % state.smoothed.shape[0]
        for group in range(state.nodes.shape[0]):
            state.priors[0, group, place] = state.window_priors[0, group, row]
            state.priors[1, group, place] = state.window_priors[1, group, row]
    compute_joints(ctx)


@compiled
def group_before(ctx, start):
    """Return `RunLengthFilter._group_before`; FREE if the best segmentation has no such start."""
    state = state_at(ctx)
    node = best_node(ctx)
    while node != state.counters[0].root and node != FREE:
        if state.node_start[node] == start:
            return state.node_group[node]
        node = state.node_parent[node]
    return FREE


@compiled
def drop_hypothesis(ctx, place):
    """Remove the hypothesis at `place`, and move the later ones forward."""
    state = state_at(ctx)
    me = state.counters[0]
    me.living -= 1
    living, slot, rows, nodes = me.living, state.slots[place], state.rows, state.nodes
    for group in range(nodes.shape[0]):
        release(ctx, nodes[group, place])
        for i in range(place, living):
            nodes[group, i] = nodes[group, i + 1]
    for i in range(place, living):
        state.starts[i] = state.starts[i + 1]
        state.slots[i] = state.slots[i + 1]
    state.slots[living] = slot
    for row in range(rows.shape[0]):
        move_up(rows[row], place, living)


@compiled
def move_up(values, first, last):
    """Move the values after `first`, up to `last`, forward by one place."""
    for i in range(first, last):
        values[i] = values[i + 1]


@compiled
def add_observation(ctx, changepoint):
    """Update every hypothesis with the observation, and add one that starts at it."""
    model, state = model_at(ctx), state_at(ctx)
    me = state.counters[0]
    joins, newborn = me.living > 0, me.living
    if not joins:
        me.opening = me.count
    is_first_step = model.settings[0].stepwise == 1 and me.count == me.opening + 1 and changepoint != 1
    if is_first_step:
        newborn = 0
        forget_next(ctx)
    else:
        me.living += 1
        state.starts[newborn] = me.count
        place_next_start(ctx, newborn)
    append_to_past(ctx, joins)
    state.sums[:, newborn] = 0.0
    state.profiles[:, state.slots[newborn]] = 0.0
    count_ages(ctx)
    for c in range(model.channels.shape[0]):
        update_channel(ctx, c, joins)
    weigh_kinds(ctx)
    if changepoint == 1:
        while me.living > 1:
            drop_hypothesis(ctx, 0)
    elif changepoint == 0 and me.living > 1:
        drop_hypothesis(ctx, me.living - 1)
        state.next[:] = -math.inf
    elif is_first_step:
        state.next[:] = -math.inf
    remember(ctx)
    copy_row(state.previous, state.now)
    me.count += 1


@compiled
def hazard_row(state, place):
    """Return the row of the hazard's tables: 1 if the past before this hypothesis' start is unknown, else
    0.
    """
    return 1 if state.starts[place] == state.counters[0].opening else 0


@compiled
def count_ages(ctx):
    """Count the observations of each segment.

    With step models the first one of a recording, or after a gap, has no step and is omitted.
    """
    model, state = model_at(ctx), state_at(ctx)
    me = state.counters[0]
    for place in range(me.living):
        start = state.starts[place]
        has_step = model.settings[0].stepwise == 0 or start != me.opening or start == me.count
        state.ages[place] = me.count - start + int(has_step)


@compiled
def forget_next(ctx):
    """Release the nodes of the next start."""
    state = state_at(ctx)
    for i in range(state.next_nodes.size):
        release(ctx, state.next_nodes[i])


@compiled
def place_next_start(ctx, place):
    """Move the priors and nodes of the next start to the hypothesis at `place`."""
    state = state_at(ctx)
    groups = state.nodes.shape[0]
    for group in range(groups):
        node, best = state.next_nodes[group], state.next[1, group]
        state.priors[0, group, place], state.priors[1, group, place] = state.next[0, group], best
        if best == -math.inf:
            release(ctx, node)
            node = FREE
        state.nodes[group, place] = node
    release(ctx, state.next_nodes[groups])


@compiled
def append_to_past(ctx, joins):
    """Append the observation to `state.past`; the first observation fills it completely."""
    state = state_at(ctx)
    past = state.past
    last = past.shape[0] - 1
    for i in range(last + 1):
        for a in range(AXES):
            past[i, a] = past[i + 1, a] if joins and i < last else state.now[a]
            past[i, AXES + a] = past[i + 1, AXES + a] if joins and i < last else state.now[ROTATION + a]
            past[i, FORCES + a] = past[i + 1, FORCES + a] if joins and i < last else state.now[FORCE + a]


@compiled
def weigh_kinds(ctx):
    """Compute `SegmentModelSet.kind_log_evidence` and `combine`."""
    model, state = model_at(ctx), state_at(ctx)
    lanes, kinds, plain = lanes_of(state.counters[0].living), state.kinds, state.plain
    for k in range(kinds.shape[0]):
        kinds[k, :lanes] = model.log_weight[k]
        for c in range(model.members.shape[1]):
            if model.members[k, c]:
                add_values(kinds[k], state.channel[c], lanes)
    combine_groups(ctx, plain, 1.0, lanes)
    power = model.settings[0].power
    if power != 1.0:
        combine_groups(ctx, state.evidence, power, lanes)
    else:
        for group in range(plain.shape[0]):
            copy_values(state.evidence[group], plain[group], lanes)


@compiled
def combine_groups(ctx, evidence, power, lanes):
    """Compute `SegmentModelSet.combine` of the kinds' evidence to some power."""
    model, state = model_at(ctx), state_at(ctx)
    kinds, total, each = state.kinds, state.work[0], state.work[1]
    evidence[:, :lanes] = -math.inf
    for k in range(kinds.shape[0]):
        temper(each, kinds[k], power, lanes)
        raise_to_larger(evidence[model.groups[k]], each, lanes)
    if model.settings[0].maximum:
        return
    for group in range(evidence.shape[0]):
        total[:lanes] = 0.0
        for k in range(kinds.shape[0]):
            if model.groups[k] == group:
                temper(each, kinds[k], power, lanes)
                subtract_largest(each, each, evidence[group], lanes)
                exponentials(each, 0.0, lanes)
                add_values(total, each, lanes)
        logarithms(total, lanes)
        add_values(evidence[group], total, lanes)


@compiled
def temper(each, values, power, lanes):
    """Compute `SegmentModelSet.temper` of one kind."""
    for i in range(lanes):
        each[i] = power * values[i]


@compiled
def copy_values(target, values, lanes):
    """Copy values to a target."""
    for i in range(lanes):
        target[i] = values[i]


@compiled
def raise_to_larger(largest, values, lanes):
    """Store the larger of two values at each place."""
    for i in range(lanes):
        largest[i] = max(largest[i], values[i])


@compiled
def subtract_largest(difference, values, largest, lanes):
    """Subtract the largest value at each place."""
    for i in range(lanes):
        difference[i] = values[i] - largest[i]


@compiled
def prepare_next(ctx):
    """Compute the sum and maximum over segments that end now, by group, and the links of the next start."""
    model, state = model_at(ctx), state_at(ctx)
    me, terms, power = state.counters[0], state.terms, model.settings[0].power
    for group in range(state.nodes.shape[0]):
        best, chosen = -math.inf, 0
        for place in range(me.living):
            mass = model.log_mass[hazard_row(state, place), me.count - state.starts[place]]
            terms[place] = state.priors[0, group, place] + (power * mass + state.evidence[group, place])
            score = state.priors[1, group, place] + (mass + state.plain[group, place])
            if score > best:
                best, chosen = score, place
        state.ended[1, group], state.ended_at[group] = best, chosen
        state.ended[0, group] = shares_of(terms, me.living)
        keep_shares(ctx, me.count, group, state.starts, terms, me.living)
    link_next_start(ctx, me.count, False)
    make_nodes(ctx)


@compiled
def make_nodes(ctx):
    """Make the next start's nodes, one for each group with a descendant."""
    state = state_at(ctx)
    count, nodes = state.counters[0].count, state.next_nodes
    for i in range(nodes.size):
        before, node = state.next_before[i], node_made(ctx, nodes, i)
        if i < nodes.size - 1 and state.next[1, i] == -math.inf:
            nodes[i] = FREE
        elif node != FREE:
            nodes[i] = refer(ctx, node)
        else:
            at = state.ended_at[before]
            nodes[i] = new_node(ctx, count, state.nodes[before, at], before, state.kinds[:, at])


@compiled
def take_likeliest(ctx):
    """Let every group of the next start descend from the likeliest segment that ends there."""
    state = state_at(ctx)
    groups = state.nodes.shape[0]
    for group in range(groups):
        release(ctx, state.next_nodes[group])
        state.next_nodes[group] = refer(ctx, state.next_nodes[groups])


@compiled
def compute_joints(ctx):
    """Compute `RunLengthFilter.log_joint`."""
    model, state = model_at(ctx), state_at(ctx)
    me, pairs, power = state.counters[0], state.pairs, model.settings[0].power
    for place in range(me.living):
        survived = power * model.log_survival[hazard_row(state, place), me.count - 1 - state.starts[place]]
        for group in range(pairs.shape[0]):
            pairs[group, place] = state.priors[0, group, place] + survived + state.evidence[group, place]
        sum_pairs(ctx, place)


@compiled
def sum_pairs(ctx, place):
    """Compute the log joint of a hypothesis, summed over its groups, to `state.joint`."""
    state = state_at(ctx)
    pairs, peak, total = state.pairs, -math.inf, 0.0
    for group in range(pairs.shape[0]):
        peak = max(peak, pairs[group, place])
    for group in range(pairs.shape[0]):
        total += math.exp(pairs[group, place] - peak) if peak > -math.inf else 1.0
    state.joint[place] = peak + math.log(total)


@compiled
def prune(ctx):
    """Drop hypotheses of negligible probability, and compute the joints of the others."""
    model, state = model_at(ctx), state_at(ctx)
    me, settings = state.counters[0], model.settings[0]
    compute_joints(ctx)
    least = largest_of(state.joint, me.living) + settings.log_prune
    before = me.living
    for place in range(before - settings.keep_youngest - 1, -1, -1):
        if not state.joint[place] >= least:
            drop_hypothesis(ctx, place)
        else:
            drop_pairs(ctx, place, least)
    if me.living > settings.cap:
        me.capped += 1
    while me.living > settings.cap:
        least_at = 0
        for place in range(1, me.living - settings.keep_youngest):
            if state.joint[place] < state.joint[least_at]:
                least_at = place
        drop_hypothesis(ctx, least_at)


@compiled
def drop_pairs(ctx, place, least):
    """Drop the groups of a hypothesis whose joint probability is below `least`."""
    state = state_at(ctx)
    for group in range(state.nodes.shape[0]):
        if state.pairs[group, place] < least:
            state.priors[0, group, place] = state.priors[1, group, place] = -math.inf
            state.pairs[group, place] = -math.inf
            release(ctx, state.nodes[group, place])
            state.nodes[group, place] = FREE
    sum_pairs(ctx, place)


# --- what is certain ------------------------------------------------------------------------------------


@compiled
def latest_certain_start(ctx):
    """Return the latest start of the best segmentation that is certain and not yet final; -1 without one."""
    model, state = model_at(ctx), state_at(ctx)
    me, settings = state.counters[0], model.settings[0]
    oldest, youngest = me.count - settings.window, me.count - 1 - settings.certain_after
    node = best_node(ctx)
    after = me.count  # the start that follows in the path; count is none
    while node not in (me.root, FREE):
        start, parent = state.node_start[node], state.node_parent[node]
        if start < oldest:
            return -1
        if start <= youngest:
            others = (state.node_start[parent], after)
            if event_probability(ctx, start, others) > settings.certain:
                return start
        after, node = start, parent
    return -1


@compiled
def best_node(ctx):
    """Return the node of the best segmentation's last segment, at its start."""
    place, group = best_pair(ctx)
    return state_at(ctx).nodes[group, place]


@compiled
def best_pair(ctx):
    """Return place and group of the last segment of the best segmentation."""
    model, state = model_at(ctx), state_at(ctx)
    me = state.counters[0]
    best, chosen, of_group = -math.inf, 0, 0
    for place in range(me.living):
        survived = model.log_survival[hazard_row(state, place), me.count - 1 - state.starts[place]]
        for group in range(state.nodes.shape[0]):
            score = state.priors[1, group, place] + survived + state.plain[group, place]
            if score > best:
                best, chosen, of_group = score, place, group
    return chosen, of_group


@compiled
def write_segmentation(ctx, path):
    """Write start, and number of the best kind of its group, of each segment of the best segmentation.

    path: (n, 2), n one more than the number of nodes; the latest segment first. Returns the number of
    segments.
    """
    model, state = model_at(ctx), state_at(ctx)
    me = state.counters[0]
    place, group = best_pair(ctx)
    path[0, 0], path[0, 1] = state.starts[place], best_kind(state.kinds[:, place], model.groups, group)
    node, n = state.nodes[group, place], 1
    while node not in (me.root, FREE):
        kind = best_kind(state.node_kinds[node], model.groups, state.node_group[node])
        node = state.node_parent[node]
        path[n, 0], path[n, 1] = state.node_start[node], kind
        n += 1
    return n


@compiled
def best_kind(kinds, groups, group):
    """Return the number of the kind of a group with most evidence, the first of equal ones."""
    best = -1
    for kind in range(kinds.size):
        if groups[kind] == group and (best < 0 or kinds[kind] > kinds[best]):
            best = kind
    return best


@compiled
def event_probability(ctx, start, others):
    """Return `RunLengthFilter.event_probability` of a start in the window with no decided start nearby."""
    state = state_at(ctx)
    me = state.counters[0]
    first = max(0, me.count - state.smoothed.shape[0])
    total = 0.0
    for near in (start - 1, start, start + 1):
        if 0 <= near < me.count and near != others[0] and near != others[1]:
            total += me.left if near < first else state.smoothed[near - first]
    return min(total, 1.0)
