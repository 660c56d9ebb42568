"""One step of the filter: the twin of `OnlineFilter.step` and `OnlineFilter.condition`."""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

import math

from caesura_service.changepoint.kernels.channels import take
from caesura_service.changepoint.kernels.compiling import compiled
from caesura_service.changepoint.kernels.elementary import exp_of_negative, log_sum_exp, most_of

FREE = -1
UNKNOWN = -1
NEGLIGIBLE = -45.0  # a term so far below the largest, in logarithms, changes no sum


@compiled
def step(model, state, z, boundary, changepoint):
    """Take one observation (7,): position, force, whether the gripper holds something.

    changepoint: 1 or 0 where it is known whether a segment starts here, else UNKNOWN. There has to be room
    for one more hypothesis and one more node, and the tables have to reach far enough.

    Returns whether an observation left the window, its smoothed probability, how many segments became final,
    and the start that is certain now, -1 without one.
    """
    me = state.counters[0]
    me.settled = 0
    if boundary:
        while me.living:
            drop(state, me.living - 1)
    grow(model, state, z, changepoint)
    prepare_next(model, state)
    prune(model, state)
    settle(state)
    leaving = me.count > state.window_priors.shape[0]
    if leaving:
        me.left = state.smoothed[0]
    smooth(model, state)
    return leaving, me.left, me.settled, certain(model, state)


@compiled
def condition(model, state, start):
    """Take it for certain that a segment starts there; there has to be room for a node a sample since."""
    me = state.counters[0]
    me.settled = 0
    sum_from(model, state, start)
    oldest_first = 0
    while oldest_first < me.living:
        if state.starts[state.order[oldest_first]] < start:
            drop(state, oldest_first)
        else:
            oldest_first += 1
    size = state.window_priors.shape[0]
    for place in range(me.living):
        slot = state.order[place]
        copy(state.priors[slot], state.window_priors[state.starts[slot] % size])
    join(model, state)
    settle(state)
    smooth(model, state)


# --- hypotheses and nodes -------------------------------------------------------------------------------


@compiled
def copy(target, source):
    """One row to another; an assignment would allocate, lest they overlap."""
    for i in range(target.size):
        target[i] = source[i]


@compiled
def drop(state, place):
    """Let go of the hypothesis at this place of the order."""
    me = state.counters[0]
    slot = state.order[place]
    release(state, state.nodes[slot])
    for i in range(place, me.living - 1):
        state.order[i] = state.order[i + 1]
        state.joint[i] = state.joint[i + 1]
    state.order[me.living - 1] = slot
    me.living -= 1


@compiled
def release(state, node):
    """One reference less; what nobody refers to is free, and lets go of its parent. The root stays."""
    state.node_references[node] -= 1
    while state.node_references[node] == 0:
        parent = state.node_parent[node]
        state.node_start[node] = FREE
        state.counters[0].nodes -= 1
        if parent == FREE:
            return
        node = parent
        state.node_references[node] -= 1


@compiled
def new_node(state, start, parent, kinds):
    """A node with one reference, that of whoever asked for it."""
    node = 0
    while state.node_start[node] != FREE:
        node += 1
    state.node_start[node] = start
    state.node_parent[node] = parent
    state.node_references[node] = 1
    state.node_references[parent] += 1
    copy(state.node_kinds[node], kinds)
    state.counters[0].nodes += 1
    return node


# --- the parts of a step --------------------------------------------------------------------------------


@compiled
def grow(model, state, z, changepoint):
    """Every hypothesis takes the observation, and one more starts at it."""
    me = state.counters[0]
    joins = me.living > 0
    newborn = state.order[me.living]
    state.starts[newborn] = me.count
    state.nodes[newborn] = me.next  # its reference goes over
    state.priors[newborn, 0], state.priors[newborn, 1] = me.next_prior, me.next_map
    state.rows[newborn] = 0.0
    state.moments[:, newborn] = 0.0
    state.squares[:, newborn] = 0.0
    me.living += 1
    for c in range(model.channels.shape[0]):
        take(model, state, c, z, joins)
    weigh_kinds(model, state)
    if changepoint == 1:
        while me.living > 1:
            drop(state, 0)
    elif changepoint == 0 and me.living > 1:
        drop(state, me.living - 1)
        me.next_prior = me.next_map = -math.inf
    remember(state)
    copy(state.previous, z)
    me.count += 1


@compiled
def weigh_kinds(model, state):
    """`Lattice.kind_log_evidence` and `combine`."""
    count, maximum = model.members.shape[0], model.settings[0].maximum
    for place in range(state.counters[0].living):
        slot = state.order[place]
        best = -math.inf
        for k in range(count):
            told = model.log_weight[k]
            for c in range(model.members.shape[1]):
                if model.members[k, c]:
                    told += state.channel[c, slot]
            state.kinds[slot, k] = told
            best = max(best, told)
        state.evidence[slot] = best if maximum else best + math.log(share_of_best(state.kinds[slot], best))


@compiled
def share_of_best(kinds, best):
    """Σ exp(kind − best)."""
    total = 0.0
    for k in range(kinds.size):
        if kinds[k] - best > NEGLIGIBLE:
            total += math.exp(kinds[k] - best)
    return total


@compiled
def remember(state):
    """`Window.remember`, before the observation is counted."""
    me = state.counters[0]
    now, size = me.count, state.window_priors.shape[0]
    state.window_evidence[now % size] = -math.inf
    state.window_priors[now % size, 0], state.window_priors[now % size, 1] = me.next_prior, me.next_map
    for place in range(me.living):
        slot = state.order[place]
        start = state.starts[slot]
        if start > now - size:
            state.window_evidence[start % size, now - start] = state.evidence[slot]
            for k in range(state.kinds.shape[1]):
                state.window_kinds[start % size, now - start, k] = state.kinds[slot, k]


@compiled
def prepare_next(model, state):
    """A and its maximum for the hypothesis that the next observation starts, and its node."""
    me = state.counters[0]
    best, chosen = -math.inf, 0
    for place in range(me.living):
        slot = state.order[place]
        mass = model.log_mass[me.count - state.starts[slot]] + state.evidence[slot]
        state.joint[place] = state.priors[slot, 0] + mass
        score = state.priors[slot, 1] + mass
        if score > best:
            best, chosen = score, slot
    me.next_map = best
    me.next_prior = log_sum_exp(state.joint[: me.living])
    me.next = new_node(state, me.count, state.nodes[chosen], state.kinds[chosen])


@compiled
def join(model, state):
    """`OnlineFilter.log_joint`."""
    me = state.counters[0]
    for place in range(me.living):
        slot = state.order[place]
        survived = model.log_survival[me.count - 1 - state.starts[slot]]
        state.joint[place] = state.priors[slot, 0] + survived + state.evidence[slot]


@compiled
def prune(model, state):
    """Drop what is not worth its work, and leave the joints of the rest."""
    me, settings = state.counters[0], model.settings[0]
    join(model, state)
    best = most_of(state.joint[: me.living])
    before = me.living
    for place in range(before - settings.keep_youngest - 1, -1, -1):
        if not state.joint[place] >= best + settings.log_prune:
            drop(state, place)
    if me.living > settings.cap:
        me.capped += 1
    while me.living > settings.cap:
        least = 0
        for place in range(1, me.living - settings.keep_youngest):
            if state.joint[place] < state.joint[least]:
                least = place
        drop(state, least)


@compiled
def settle(state):
    """Move the root to where the ancestries of all hypotheses, the next one included, first part."""
    me = state.counters[0]
    while state.node_references[me.root] == 1:
        child = only_child(state, me.root)
        if child == FREE:
            return
        state.settled_start[me.settled] = state.node_start[me.root]
        copy(state.settled_kinds[me.settled], state.node_kinds[child])
        me.settled += 1
        state.node_parent[child] = FREE
        state.node_references[me.root] = 0
        state.node_start[me.root] = FREE
        me.nodes -= 1
        me.root = child


@compiled
def only_child(state, node):
    """The node that goes back to this one, if one does."""
    for other in range(state.node_start.shape[0]):
        if state.node_start[other] != FREE and state.node_parent[other] == node:
            return other
    return FREE


# --- the window -----------------------------------------------------------------------------------------


@compiled
def smooth(model, state):
    """`Window.smoothed`, given the joints of the living."""
    me = state.counters[0]
    size = state.window_priors.shape[0]
    first = max(0, me.count - size)
    span = me.count - first
    terms, backward = state.terms, state.backward
    for place in range(me.living):
        terms[place] = state.joint[place]
    total = log_sum_exp(terms[: me.living])
    for i in range(span - 1, -1, -1):
        begun, last = (first + i) % size, span - 1 - i
        evidence = state.window_evidence[begun]
        follow(terms[:last], model.log_mass[1:], evidence, backward[i + 1 :])
        terms[last] = model.log_survival[last] + evidence[last]
        backward[i] = log_sum_exp(terms[: last + 1])
    for i in range(span):
        prior = state.window_priors[(first + i) % size, 0]
        state.smoothed[i] = exp_of_negative(min(prior + backward[i] - total, 0.0))


@compiled
def follow(terms, log_mass, evidence, backward):
    """That a segment of each age ended, and what came then."""
    for age in range(terms.size):
        terms[age] = log_mass[age] + evidence[age] + backward[age]


@compiled
def certain(model, state):
    """The latest start of the best segmentation that is certain and not yet final; -1 without one."""
    me, settings = state.counters[0], model.settings[0]
    oldest, youngest = me.count - settings.window, me.count - 1 - settings.certain_after
    node = best_node(model, state)
    after = me.count  # the start that follows in the path; count is none
    while node != me.root:
        start, parent = state.node_start[node], state.node_parent[node]
        if start < oldest:
            return -1
        if start <= youngest:
            others = (state.node_start[parent], after)
            if event_probability(state, start, others) > settings.certain:
                return start
        after, node = start, parent
    return -1


@compiled
def best_node(model, state):
    """Where the last segment of the best segmentation starts."""
    me = state.counters[0]
    best, chosen = -math.inf, state.order[0]
    for place in range(me.living):
        slot = state.order[place]
        survived = model.log_survival[me.count - 1 - state.starts[slot]]
        score = state.priors[slot, 1] + survived + state.evidence[slot]
        if score > best:
            best, chosen = score, slot
    return state.nodes[chosen]


@compiled
def event_probability(state, start, others):
    """`OnlineFilter.event_probability` of a start in the window, nothing near it being decided."""
    me = state.counters[0]
    first = max(0, me.count - state.window_priors.shape[0])
    total = 0.0
    for near in (start - 1, start, start + 1):
        if 0 <= near < me.count and near != others[0] and near != others[1]:
            total += me.left if near < first else state.smoothed[near - first]
    return min(total, 1.0)


@compiled
def sum_from(model, state, start):
    """`Window.sum_from`, and the nodes that follow from it."""
    me = state.counters[0]
    size = state.window_priors.shape[0]
    for before in range(max(0, me.count - size), start):
        state.window_evidence[before % size, start - before :] = -math.inf
    anew = state.anew  # nodes of start, start + 1, …
    anew[0] = node_at(state, start)
    for end in range(start + 1, me.count + 1):
        best, chosen = -math.inf, start
        for s in range(start, end):
            mass = model.log_mass[end - s] + state.window_evidence[s % size, end - 1 - s]
            state.terms[s - start] = state.window_priors[s % size, 0] + mass
            score = state.window_priors[s % size, 1] + mass
            if score > best:
                best, chosen = score, s
        total = log_sum_exp(state.terms[: end - start])
        kinds = state.window_kinds[chosen % size, end - 1 - chosen]
        anew[end - start] = new_node(state, end, anew[chosen - start], kinds)
        if end < me.count:
            state.window_priors[end % size, 0], state.window_priors[end % size, 1] = total, best
        else:
            me.next_prior, me.next_map = total, best
    refer_anew(state, start)


@compiled
def node_at(state, start):
    """The node of a start that the best segmentation has."""
    for node in range(state.node_start.shape[0]):
        if state.node_start[node] == start:
            return node
    return FREE


@compiled
def refer_anew(state, start):
    """Hypotheses behind `start`, and the next one, go over to the nodes that were made anew."""
    me, anew = state.counters[0], state.anew
    for place in range(me.living):
        slot = state.order[place]
        if state.starts[slot] > start:
            before, state.nodes[slot] = state.nodes[slot], anew[state.starts[slot] - start]
            state.node_references[state.nodes[slot]] += 1
            release(state, before)
    before, me.next = me.next, anew[me.count - start]
    state.node_references[me.next] += 1
    release(state, before)
    for end in range(me.count, start, -1):
        release(state, anew[end - start])
