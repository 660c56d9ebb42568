"""Which arrays the compiled filter works on.

A hypothesis lives in a slot, a row of every array of `State` that counts slots; `order` lists the slots of
the living, oldest first. A node is what is known at a start: which node the best segmentation before it goes
back to, and what the segment in between was. Living hypotheses, the next one, and later nodes refer to it; a
node that nobody refers to is free. The root is the node that all of them descend from.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MOST_SHARES = 4
STATES = 3  # of the contact model

# What a channel model is, and where a segment counts from.
PROFILED, WALK, CONSTANT, BIASED, LADEN, CARRIED, HELD, CONTACT, VELOCITY = range(9)
PREVIOUS, FIRST, ZERO = range(3)

CHANNEL = np.dtype(
    [
        ("model", "i8"),
        ("field", "i8"),  # where its sums begin in a hypothesis' row
        ("signal", "i8"),  # where its values begin in an observation
        ("origin", "i8"),
        ("library", "i8"),
        ("place", "i8"),  # among the channels with profiles
        ("maximum", "i8"),  # over profiles; otherwise their mixture
        ("joint", "i8"),
        ("even", "i8"),  # all precisions are 1
        ("nu0", "f8"),
        ("rho", "f8"),
        ("floor2", "f8"),
        ("shares", "i8"),
        ("share2", "f8", (MOST_SHARES,)),
        ("log_count", "f8"),  # of profiles times shares
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
        ("probability", "f8"),
        ("change", "f8"),
        ("state", "i8"),
        ("variance", "f8", (STATES,)),
        ("alpha", "f8", (STATES,)),
        ("unit", "f8"),
        ("step", "f8"),
        ("kappa0", "f8"),
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
    ]
)

COUNTERS = np.dtype(
    [
        ("count", "i8"),  # observations taken
        ("living", "i8"),  # hypotheses
        ("root", "i8"),  # node
        ("next", "i8"),  # node of the next hypothesis
        ("capped", "i8"),
        ("settled", "i8"),  # segments that became final in this step
        ("left", "f8"),  # smoothed probability of the observation that left the window last
        ("nodes", "i8"),  # that are not free
        ("next_prior", "f8"),
        ("next_map", "f8"),
    ]
)


class Model(NamedTuple):
    """What never changes, but for tables that grow as segments do."""

    settings: NDArray[Any]  # (1,) SETTINGS
    channels: NDArray[Any]  # (c,) CHANNEL
    members: NDArray[np.bool_]  # (kinds, c)
    log_weight: Floats  # (kinds,)
    values: Floats  # (libraries, rows, k) whitened; k profiles, in whole vectors
    precisions: Floats
    squares: Floats  # Σ, weighted by the precisions
    log_scales: Floats
    by_length: Floats  # (c, n) what of the evidence depends on the number of samples alone, up to some number
    log_mass: Floats  # (n,) of the hazard
    log_survival: Floats  # (n,)


class State(NamedTuple):
    """What a step changes. s: slots, n: nodes, w: window."""

    counters: NDArray[Any]  # (1,) COUNTERS
    previous: Floats  # (7,) the last observation
    order: Ints  # (s,) slots of the living, oldest first, then the free ones
    starts: Ints  # (s,)
    nodes: Ints  # (s,)
    priors: Floats  # (s, 2) A(start), and the same with maximum
    rows: Floats  # (s, fields)
    kinds: Floats  # (s, kinds) log evidence of each kind
    evidence: Floats  # (s,) over all kinds
    joint: Floats  # (s,) by place in `order`
    channel: Floats  # (c, s) log evidence of each channel
    moments: Floats  # (channels with profiles, s, 3, k) Σwyφ
    squares: Floats  # (channels with profiles, s, 3, k) Σwy²
    fresh: Floats  # (3,) scratch
    squared: Floats  # (k,) scratch
    told: Floats  # (MOST_SHARES, k) scratch
    continued: Floats  # (2, k) scratch
    scratch: Floats
    node_start: Ints  # (n,) -1: free
    node_parent: Ints  # (n,)
    node_references: Ints  # (n,)
    node_kinds: Floats  # (n, kinds) of the segment that ended here
    window_evidence: Floats  # (w, w) [start mod w, age]
    window_kinds: Floats  # (w, w, kinds)
    window_priors: Floats  # (w, 2)
    smoothed: Floats  # (w,)
    backward: Floats  # (w,) scratch
    terms: Floats  # scratch
    anew: Ints  # (w + 1,) scratch
    settled_start: Ints  # (n,)
    settled_kinds: Floats  # (n, kinds)


def fresh_state(
    settings: NDArray[Any], kinds: int, channels: int, fields: int, profiled: tuple[int, int]
) -> State:
    """Before the first observation: one node, the root, where the first segment starts."""
    window = int(settings["window"][0])
    slots, nodes = int(settings["cap"][0]) + 1, 4 * (window + 2)
    state = State(
        counters=np.zeros(1, COUNTERS),
        previous=np.zeros(7),
        order=np.arange(slots),
        starts=np.zeros(slots, np.int64),
        nodes=np.zeros(slots, np.int64),
        priors=np.zeros((slots, 2)),
        rows=np.zeros((slots, fields)),
        kinds=np.zeros((slots, kinds)),
        evidence=np.zeros(slots),
        joint=np.zeros(slots),
        channel=np.zeros((channels, slots)),
        moments=np.zeros((profiled[0], slots, 3, profiled[1])),
        squares=np.zeros((profiled[0], slots, 3, profiled[1])),
        fresh=np.zeros(3),
        squared=np.zeros(profiled[1]),
        told=np.zeros((MOST_SHARES, profiled[1])),
        continued=np.zeros((2, profiled[1])),
        scratch=np.zeros(2 * STATES),
        node_start=np.full(nodes, -1),
        node_parent=np.full(nodes, -1),
        node_references=np.zeros(nodes, np.int64),
        node_kinds=np.zeros((nodes, kinds)),
        window_evidence=np.full((window, window), -np.inf),
        window_kinds=np.zeros((window, window, kinds)),
        window_priors=np.full((window, 2), -np.inf),
        smoothed=np.zeros(window),
        backward=np.zeros(window),
        terms=np.zeros(max(window + 1, slots)),
        anew=np.zeros(window + 2, np.int64),
        settled_start=np.zeros(nodes, np.int64),
        settled_kinds=np.zeros((nodes, kinds)),
    )
    state.counters["nodes"] = 1
    state.node_start[0], state.node_references[0] = 0, 1
    return state


def with_more_nodes(state: State) -> State:
    """The same with twice the room for nodes."""
    return state._replace(
        **{
            name: np.concatenate([array, np.full_like(array, -1)])
            for name, array in state._asdict().items()
            if name.startswith(("node_", "settled_"))
        }
    )
