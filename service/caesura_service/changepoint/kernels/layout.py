"""The arrays of the compiled filter.

Living hypotheses occupy the first places, oldest first and without a gap, so that loops can be vectorised;
later places are undefined. A hypothesis' sums over profiles are too many to move when another one is dropped:
they stay in its slot. A node is the past of a start: its parent node in the best segmentation, and the
segment in between. Living hypotheses, the next one, and later nodes refer to it; a node without a reference
is free. The root is the node from which all of them descend. A hypothesis is a start with a group of kinds;
each group has its own node.

The data of an observation in the window are in row or column (observation mod w).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FREE = -1  # no node, or no group
VECTOR = 8  # numbers that a loop takes at once; what is left over it takes one by one
AXES = 3
BLOCK = 32  # profiles that are worked on at once
MOST_SHARES = 4
MOST_CHORDS = 3
STATES = 3  # of the contact model
# Where the values of an observation begin. All but the last, which may be unknown, have to be finite.
POSITION, FORCE, ROTATION, TORSION, HOLDING = (AXES * i for i in range(5))
SEEN = HOLDING + 1  # numbers of an observation
PAST = 16  # observations that a model may look back on
FORCES = 2 * AXES  # first column of the forces in `State.past`

# Rows of a library's table: φw, w, Σφ²w, Σ log scale.
WEIGHED, PRECISION, NORM, LOG_SCALE = range(4)

# The class of a channel model.
PROFILE_MODEL, RANDOM_WALK, CONSTANT_LEVEL, FREE_SPACE_FORCE, LOAD_FORCE = range(5)
THESIS_LOAD_FORCE, GRIPPER_HOLDING, CONTACT_MIXTURE, CONSTANT_VELOCITY = range(5, 9)
DISSIPATIVE_CONTACT, GUIDED_MOTION, CORNER_WEIGHT, TURN_IN_PLACE = range(9, 13)
RATE_BOUNDS, NO_CONTACT_RISE, TURN_RESISTANCE, TRACED_MOTION = range(13, 17)

# Where a segment's values count from.
PREVIOUS, FIRST, ZERO = range(3)

CHANNEL = np.dtype(
    [
        ("model", "i8"),
        ("field", "i8"),  # where its sums begin in a hypothesis' row
        ("signal", "i8"),  # where its values begin in an observation
        ("origin", "i8"),
        ("library", "i8"),  # among the channels with profiles
        ("blocks", "i8"),  # of profiles
        ("maximum", "i8"),  # over profiles; otherwise their mixture
        ("joint", "i8"),
        ("even", "i8"),  # all precisions are 1
        ("best_only", "i8"),  # the largest of even ones, each axis for itself, the scale being the floor's
        ("nu0", "f8"),
        ("rho", "f8"),
        ("white", "f8"),  # 1 / √(1 − ρ²)
        ("floor2", "f8"),
        ("shares", "i8"),
        ("share2", "f8", (MOST_SHARES,)),
        ("explained", "i8"),  # samples that the target's prior takes the place of
        ("pooled", "i8"),  # values a sample, in one group of axes
        ("unvalued", "i8"),  # samples that count no value
        ("unwhitened", "i8"),  # samples that are not whitened
        ("whitening", "f8"),  # log density of whitening a sample
        ("offset", "f8"),  # of the log evidence, whatever the length
        ("reach2", "f8"),
        ("least", "f8"),
        ("pace", "f8"),
        ("scale2", "f8"),
        ("nu", "f8"),
        ("still", "f8"),
        ("presence", "f8"),
        ("constant", "f8"),  # of the log density
        ("bias2", "f8"),
        ("absence", "f8"),
        ("lightest", "f8"),  # [N]
        ("heaviest", "f8"),  # [N]
        ("memory", "i8"),  # observations before a start whose level may go on; 0: it does not
        ("log_continued", "f8"),  # log probability that it does
        ("probability", "f8"),
        ("change", "f8"),
        ("state", "i8"),
        ("variance", "f8", (STATES,)),
        ("alpha", "f8", (STATES,)),
        ("unit", "f8"),
        ("step", "f8"),
        ("kappa0", "f8"),
        ("burst2", "f8"),
        ("burst_steps", "i8"),
        ("away", "f8"),
        ("away_steps", "i8"),
        ("gamma", "f8"),
        ("standing", "f8"),
        ("fast2", "f8"),
        ("turn", "f8"),  # [°]
        ("turn_width", "f8"),
        ("dip", "f8"),
        ("dip_width", "f8"),
        ("straight", "f8"),
        ("straight_width", "f8"),
        ("noise2", "f8"),
        ("chords", "i8", (MOST_CHORDS,)),
        ("reaches", "i8", (MOST_CHORDS,)),
        ("chord_count", "i8"),
        ("longest_reach", "i8"),
        ("reach", "i8"),
        ("aligned2", "f8"),
        ("force2", "f8"),  # [N²] from which a force has a direction
    ]
)

SETTINGS = np.dtype(
    [
        ("log_prune", "f8"),
        ("keep_youngest", "i8"),
        ("cap", "i8"),
        ("window", "i8"),
        ("certain", "f8"),
        ("certain_after", "i8"),
        ("maximum", "i8"),  # over kinds; otherwise their mixture
        ("power", "f8"),  # of the joint in sums
        ("stepwise", "i8"),
    ]
)

COUNTERS = np.dtype(
    [
        ("count", "i8"),  # observations taken
        ("living", "i8"),  # hypotheses
        ("opening", "i8"),  # the last observation that has no step from one before
        ("root", "i8"),  # node
        ("capped", "i8"),
        ("settled", "i8"),  # segments that became final in this step
        ("left", "f8"),  # smoothed probability of the observation that left the window last
        ("nodes", "i8"),  # that are not free
    ]
)


class Model(NamedTuple):
    """The constants of the filter; only the tables grow, with the length of segments."""

    settings: NDArray[Any]  # (1,) SETTINGS
    channels: NDArray[Any]  # (c,) CHANNEL
    members: NDArray[np.bool_]  # (kinds, c)
    log_weight: Floats  # (kinds,)
    groups: Ints  # (kinds,) group of each kind
    transition: Floats  # (groups, groups) `SegmentModelSet.log_transition`
    profiles: Floats  # (libraries, samples, blocks, 4, BLOCK) whitened
    steps: Floats  # (libraries, blocks, 2, BLOCK) by which the last two go on where the table ends
    by_length: Floats  # (c, n) what of the evidence depends on the number of samples alone, up to some number
    log_mass: Floats  # (2, n) of the hazard, and of its residual life
    log_survival: Floats  # (2, n)


class State(NamedTuple):
    """The arrays that a step changes. s: places or slots, n: nodes, g: groups, w: window.

    S and W ≥ w in whole vectors.
    """

    counters: NDArray[Any]  # (1,) COUNTERS
    now: Floats  # (13,) the observation: position, force, rotation, torsion, what the gripper holds
    previous: Floats  # (13,) the one before
    past: Floats  # (PAST, 9) the last positions, rotations and forces, this one included
    starts: Ints  # (s,)
    nodes: Ints  # (g, s) what a segment of each group descends from; FREE where that has been pruned
    slots: Ints  # (s,) those of the living, then the free ones
    ages: Floats  # (s,) observations that count, the last one included
    rows: Floats  # (rows, s) the next seven, one after the other
    priors: Floats  # (2, g, s) A(start), and the same with maximum
    joint: Floats  # (s,)
    evidence: Floats  # (g, s) over the kinds of a group, to its power
    plain: Floats  # (g, s) the same as it is
    pairs: Floats  # (g, s) joint of each group
    kinds: Floats  # (kinds, s) log evidence of each kind
    sums: Floats  # (fields, s) what the channel models keep
    channel: Floats  # (c, s) log evidence of each channel
    work: Floats  # (WORK, s) scratch
    profiles: Floats  # (libraries, s, blocks, 6, BLOCK) Σwyφ of each axis, then Σwy²
    residuals: Floats  # (BLOCK,) scratch
    log_evidence: Floats  # (blocks · MOST_SHARES, BLOCK) scratch
    continued: Floats  # (2, BLOCK) scratch
    scratch: Floats
    ended: Floats  # (2, g) log sum, and log maximum, of what ends before the next start, by its last group
    ended_at: Ints  # (g,) the place, or the start, of that last segment in the maximum
    next: Floats  # (2, g) A(next start), and the same with maximum
    next_before: Ints  # (g + 1,) the group before it in the maximum; last the likeliest of all
    next_nodes: Ints  # (g + 1,) their nodes
    node_start: Ints  # (n,) -1: free
    node_parent: Ints  # (n,)
    node_references: Ints  # (n,)
    node_group: Ints  # (n,) of the segment that ended here
    node_kinds: Floats  # (n, kinds) of that segment
    window_evidence: Floats  # (w, g, W) of the segment [end, group, start]
    window_plain: Floats  # (w, g, W) the same as it is
    window_kinds: Floats  # (w, w, kinds) the same of each kind
    window_shares: (
        Floats  # (w, g, W) probability [next, group, start] that what ends before `next` began at `start`
    )
    window_flow: (
        Floats  # (w, g, g) probability [start, before, group] of the group before a segment of a group
    )
    window_priors: Floats  # (2, g, W)
    window_ended: Floats  # (2, g, W) `ended` at each start
    window_before: Ints  # (g, W) `next_before` at each start
    window_free: Ints  # (W,) whether every group may follow every other at a start
    window_opens: Ints  # (W,) whether nothing is known of what was before a start
    begun: Floats  # (g, W) scratch
    smoothed: Floats  # (w,)
    terms: Floats  # scratch
    anew: Ints  # (w + 2, g + 1) scratch
    counted: Ints  # (w + 2,) scratch
    settled_start: Ints  # (n,)
    settled_group: Ints  # (n,)
    settled_kinds: Floats  # (n, kinds)


WORK = 7 + 2 * MOST_SHARES


def fresh_state(
    settings: NDArray[Any], kinds: int, groups: int, channels: int, fields: int, profiled: tuple[int, int]
) -> State:
    """Return the state before the first observation: one node, the root, where the first segment starts."""
    window = int(settings["window"][0])
    slots, nodes = lanes_of(int(settings["cap"][0]) + 1), (groups + 1) * 4 * (window + 2)
    libraries, blocks = profiled
    first = 5 * groups + 1  # rows of priors, joint, evidence twice, and pairs
    wide = lanes_of(window)
    shapes: dict[str, tuple[int, ...]] = {
        "now": (SEEN,),
        "previous": (SEEN,),
        "past": (PAST, 3 * AXES),
        "ages": (slots,),
        "rows": (first + kinds + fields, slots),
        "channel": (channels, slots),
        "work": (WORK, slots),
        "profiles": (libraries, slots, blocks, 6, BLOCK),
        "residuals": (BLOCK,),
        "log_evidence": (blocks * MOST_SHARES, BLOCK),
        "continued": (2, BLOCK),
        "scratch": (max(2 * STATES, PAST),),
        "ended": (2, groups),
        "next": (2, groups),
        "node_kinds": (nodes, kinds),
        "window_evidence": (window, groups, wide),
        "window_plain": (window, groups, wide),
        "window_kinds": (window, window, kinds),
        "window_shares": (window, groups, wide),
        "window_flow": (window, groups, groups),
        "window_priors": (2, groups, wide),
        "window_ended": (2, groups, wide),
        "begun": (groups, wide),
        "smoothed": (window,),
        "terms": (max(lanes_of(window + 1), slots),),
        "settled_kinds": (nodes, kinds),
    }
    arrays = {name: _zeros(shape) for name, shape in shapes.items()}
    rows = arrays["rows"]
    state = State(
        **arrays,
        counters=np.zeros(1, COUNTERS),
        starts=np.zeros(slots, np.int64),
        nodes=np.full((groups, slots), FREE),
        slots=np.arange(slots),
        priors=rows[: 2 * groups].reshape(2, groups, slots),
        joint=rows[2 * groups],
        evidence=rows[2 * groups + 1 : 3 * groups + 1],
        plain=rows[3 * groups + 1 : 4 * groups + 1],
        pairs=rows[4 * groups + 1 : first],
        kinds=rows[first : first + kinds],
        sums=rows[first + kinds :],
        ended_at=np.zeros(groups, np.int64),
        next_before=np.full(groups + 1, FREE),
        next_nodes=np.zeros(groups + 1, np.int64),
        node_start=np.full(nodes, FREE),
        node_parent=np.full(nodes, FREE),
        node_references=np.zeros(nodes, np.int64),
        node_group=np.full(nodes, FREE),
        window_before=np.full((groups, wide), FREE),
        window_free=np.ones(wide, np.int64),
        window_opens=np.zeros(wide, np.int64),
        anew=np.zeros((window + 2, groups + 1), np.int64),
        counted=np.zeros(window + 2, np.int64),
        settled_start=np.zeros(nodes, np.int64),
        settled_group=np.zeros(nodes, np.int64),
    )
    state.window_evidence[:] = state.window_plain[:] = state.window_priors[:] = -np.inf
    state.counters["nodes"] = 1
    state.node_start[0], state.node_references[0] = 0, groups + 1
    return state


def lanes_of(n: int) -> int:
    """Return n rounded up to a multiple of VECTOR."""
    return -(-n // VECTOR) * VECTOR


def _zeros(shape: tuple[int, ...]) -> Floats:
    """Return an array of zeros aligned to a vector and a cache line."""
    size = int(np.prod(shape))
    memory = np.zeros(size + VECTOR)
    first = -(memory.ctypes.data // memory.itemsize) % VECTOR
    return memory[first : first + size].reshape(shape)


def with_more_nodes(state: State) -> State:
    """Return the state with twice the capacity for nodes."""
    return state._replace(
        **{
            name: np.concatenate([array, np.full_like(array, -1)])
            for name, array in state._asdict().items()
            if name.startswith(("node_", "settled_"))
        }
    )


def _examples() -> tuple[Model, State]:
    """Return an empty model and state, whose arrays have the types of all others."""
    settings = np.zeros(1, SETTINGS)
    settings["window"] = 1
    model = Model(
        settings,
        np.zeros(1, CHANNEL),
        np.zeros((1, 1), np.bool_),
        np.zeros(1),
        np.zeros(1, np.int64),
        np.zeros((1, 1)),
        np.zeros((1, 1, 1, 4, BLOCK)),
        np.zeros((1, 1, 2, BLOCK)),
        np.zeros((1, 1)),
        np.zeros((2, 1)),
        np.zeros((2, 1)),
    )
    return model, fresh_state(settings, 1, 1, 1, 1, (1, 1))


A_MODEL, A_STATE = _examples()
