"""One step of the filter: the twin of `OnlineFilter.step` and `OnlineFilter.condition`."""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

import math

from caesura_service.changepoint.kernels.channels import take
from caesura_service.changepoint.kernels.elementary import exponentials, logarithms, most_of, shares_of
from caesura_service.changepoint.kernels.nodes import copy, new_node, release, settle
from caesura_service.changepoint.kernels.residuals import whole
from caesura_service.changepoint.kernels.unpacking import model_at, state_at
from caesura_service.changepoint.kernels.window import keep_shares, remember, smooth, sum_from
from caesura_service.compiling.decorators import compiled

HOLDING = 6  # place in an observation; before it what has to be finite
UNKNOWN = -1
REFUSED = -2


@compiled
def step(here, boundary, changepoint):
    """Take the observation `state.now`, of which position and force have to be finite.

    here: where the table of the arrays is. boundary: it follows a gap. changepoint: 1 or 0 where it is known
    whether a segment starts here, else UNKNOWN. There has to be room for one more hypothesis and one more
    node, and the model's tables have to reach far enough.

    Returns how many segments became final, and the start that is certain now, -1 without one; REFUSED, and
    nothing has changed, where a value is not finite. `counters.left` is the smoothed probability of what
    left the window.
    """
    state = state_at(here)
    me = state.counters[0]
    for i in range(HOLDING):
        if not math.isfinite(state.now[i]):
            return 0, REFUSED
    me.settled = 0
    if boundary:
        while me.living:
            drop(here, me.living - 1)
    grow(here, changepoint)
    prepare_next(here)
    prune(here)
    settle(here)
    if me.count > state.smoothed.shape[0]:
        me.left = state.smoothed[0]
    smooth(here)
    return me.settled, certain(here)


@compiled
def condition(here, start):
    """Take it for certain that a segment starts there; there has to be room for a node a sample since."""
    state = state_at(here)
    me = state.counters[0]
    me.settled = 0
    sum_from(here, start)
    while me.living and state.starts[0] < start:
        drop(here, 0)
    for place in range(me.living):
        row = state.starts[place] % state.smoothed.shape[0]
        state.priors[0, place], state.priors[1, place] = (
            state.window_priors[0, row],
            state.window_priors[1, row],
        )
    join(here)
    settle(here)
    smooth(here)


@compiled
def drop(here, place):
    """Let go of the hypothesis in this place, and move those behind it up."""
    state = state_at(here)
    me = state.counters[0]
    me.living -= 1
    living, slot, rows = me.living, state.slots[place], state.rows
    release(here, state.nodes[place])
    for i in range(place, living):
        state.starts[i] = state.starts[i + 1]
        state.nodes[i] = state.nodes[i + 1]
        state.slots[i] = state.slots[i + 1]
    state.slots[living] = slot
    for row in range(rows.shape[0]):
        move_up(rows[row], place, living)


@compiled
def move_up(values, first, last):
    """By one place."""
    for i in range(first, last):
        values[i] = values[i + 1]


@compiled
def grow(here, changepoint):
    """Every hypothesis takes the observation, and one more starts at it."""
    model, state = model_at(here), state_at(here)
    me = state.counters[0]
    joins, newborn = me.living > 0, me.living
    me.living += 1
    state.starts[newborn] = me.count
    state.nodes[newborn] = me.next  # its reference goes over
    state.priors[0, newborn], state.priors[1, newborn] = me.next_prior, me.next_map
    state.sums[:, newborn] = 0.0
    state.profiles[:, state.slots[newborn]] = 0.0
    for place in range(me.living):
        state.ages[place] = me.count - state.starts[place] + 1
    for c in range(model.channels.shape[0]):
        take(here, c, joins)
    weigh_kinds(here)
    if changepoint == 1:
        while me.living > 1:
            drop(here, 0)
    elif changepoint == 0 and me.living > 1:
        drop(here, me.living - 1)
        me.next_prior = me.next_map = -math.inf
    remember(here)
    copy(state.previous, state.now)
    me.count += 1


@compiled
def weigh_kinds(here):
    """`Lattice.kind_log_evidence` and `combine`."""
    model, state = model_at(here), state_at(here)
    lanes, kinds, evidence = whole(state.counters[0].living), state.kinds, state.evidence
    evidence[:lanes] = -math.inf
    for k in range(kinds.shape[0]):
        kinds[k, :lanes] = model.log_weight[k]
        for c in range(model.members.shape[1]):
            if model.members[k, c]:
                add(kinds[k], state.channel[c], lanes)
        most(evidence, kinds[k], lanes)
    if not model.settings[0].maximum:
        total, each = state.work[0], state.work[1]
        total[:lanes] = 0.0
        for k in range(kinds.shape[0]):
            beside(each, kinds[k], evidence, lanes)
            exponentials(each, 0.0, lanes)
            add(total, each, lanes)
        logarithms(total, lanes)
        add(evidence, total, lanes)


@compiled
def add(sums, values, lanes):
    """Each to its sum."""
    for i in range(lanes):
        sums[i] += values[i]


@compiled
def most(largest, values, lanes):
    """The larger of two in each place."""
    for i in range(lanes):
        largest[i] = max(largest[i], values[i])


@compiled
def beside(difference, values, largest, lanes):
    """How much less than the largest."""
    for i in range(lanes):
        difference[i] = values[i] - largest[i]


@compiled
def prepare_next(here):
    """A and its maximum for the hypothesis that the next observation starts, and its node."""
    model, state = model_at(here), state_at(here)
    me, terms = state.counters[0], state.terms
    best, chosen = -math.inf, 0
    for place in range(me.living):
        mass = model.log_mass[me.count - state.starts[place]] + state.evidence[place]
        terms[place] = state.priors[0, place] + mass
        score = state.priors[1, place] + mass
        if score > best:
            best, chosen = score, place
    me.next_map = best
    me.next_prior = shares_of(terms, me.living)
    keep_shares(here, me.count, state.starts, terms, me.living)
    me.next = new_node(here, me.count, state.nodes[chosen], state.kinds[:, chosen])


@compiled
def join(here):
    """`OnlineFilter.log_joint`."""
    model, state = model_at(here), state_at(here)
    me = state.counters[0]
    for place in range(me.living):
        survived = model.log_survival[me.count - 1 - state.starts[place]]
        state.joint[place] = state.priors[0, place] + survived + state.evidence[place]


@compiled
def prune(here):
    """Drop what is not worth its work, and leave the joints of the rest."""
    model, state = model_at(here), state_at(here)
    me, settings = state.counters[0], model.settings[0]
    join(here)
    best = most_of(state.joint, me.living)
    before = me.living
    for place in range(before - settings.keep_youngest - 1, -1, -1):
        if not state.joint[place] >= best + settings.log_prune:
            drop(here, place)
    if me.living > settings.cap:
        me.capped += 1
    while me.living > settings.cap:
        least = 0
        for place in range(1, me.living - settings.keep_youngest):
            if state.joint[place] < state.joint[least]:
                least = place
        drop(here, least)


# --- what is certain ------------------------------------------------------------------------------------


@compiled
def certain(here):
    """The latest start of the best segmentation that is certain and not yet final; -1 without one."""
    model, state = model_at(here), state_at(here)
    me, settings = state.counters[0], model.settings[0]
    oldest, youngest = me.count - settings.window, me.count - 1 - settings.certain_after
    node = best_node(here)
    after = me.count  # the start that follows in the path; count is none
    while node != me.root:
        start, parent = state.node_start[node], state.node_parent[node]
        if start < oldest:
            return -1
        if start <= youngest:
            others = (state.node_start[parent], after)
            if event_probability(here, start, others) > settings.certain:
                return start
        after, node = start, parent
    return -1


@compiled
def best_node(here):
    """Where the last segment of the best segmentation starts."""
    model, state = model_at(here), state_at(here)
    me = state.counters[0]
    best, chosen = -math.inf, 0
    for place in range(me.living):
        survived = model.log_survival[me.count - 1 - state.starts[place]]
        score = state.priors[1, place] + survived + state.evidence[place]
        if score > best:
            best, chosen = score, place
    return state.nodes[chosen]


@compiled
def event_probability(here, start, others):
    """`OnlineFilter.event_probability` of a start in the window, nothing near it being decided."""
    state = state_at(here)
    me = state.counters[0]
    first = max(0, me.count - state.smoothed.shape[0])
    total = 0.0
    for near in (start - 1, start, start + 1):
        if 0 <= near < me.count and near != others[0] and near != others[1]:
            total += me.left if near < first else state.smoothed[near - first]
    return min(total, 1.0)
