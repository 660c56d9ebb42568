"""Nodes: the best segmentation before each hypothesis, with reference counts."""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

from caesura_service.changepoint.kernels.array_tuple import state_at
from caesura_service.changepoint.kernels.layout import FREE
from caesura_service.numba_support.decorators import compiled


@compiled
def copy_row(target, source):
    """Copy one row to another; an assignment would allocate memory in case they overlap."""
    for i in range(target.size):
        target[i] = source[i]


@compiled
def release(ctx, node):
    """Decrease a node's reference count; at 0 free it and release its parent. The root stays."""
    state = state_at(ctx)
    if node == FREE:
        return
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
def new_node(ctx, start, parent, group, kinds):
    """Return a new node with one reference, the caller's."""
    state = state_at(ctx)
    node = 0
    while state.node_start[node] != FREE:
        node += 1
    state.node_start[node] = start
    state.node_parent[node] = parent
    state.node_references[node] = 1
    state.node_group[node] = group
    state.node_references[parent] += 1
    copy_row(state.node_kinds[node], kinds)
    state.counters[0].nodes += 1
    return node


@compiled
def node_at(ctx, start, group):
    """Return the node of a start after a segment of this group; FREE without one."""
    state = state_at(ctx)
    for node in range(state.node_start.shape[0]):
        if state.node_start[node] == start and state.node_group[node] == group:
            return node
    return FREE


@compiled
def node_made(ctx, nodes, i):
    """Return the node that an earlier group of the next start has after the same segment.

    FREE without one.
    """
    before, node = state_at(ctx).next_before, FREE
    for other in range(i):
        if before[other] == before[i] and nodes[other] != FREE:
            node = nodes[other]
    return node


@compiled
def refer(ctx, node):
    """Increase the node's reference count; return the node."""
    state = state_at(ctx)
    if node != FREE:
        state.node_references[node] += 1
    return node


@compiled
def settle_root(ctx):
    """Move the root to the latest node that all hypotheses, the next one included, have in common."""
    state = state_at(ctx)
    me = state.counters[0]
    while state.node_references[me.root] == 1:
        child = only_child(ctx, me.root)
        if child == FREE:
            return
        state.settled_start[me.settled] = state.node_start[me.root]
        state.settled_group[me.settled] = state.node_group[child]
        copy_row(state.settled_kinds[me.settled], state.node_kinds[child])
        me.settled += 1
        state.node_parent[child] = FREE
        state.node_references[me.root] = 0
        state.node_start[me.root] = FREE
        me.nodes -= 1
        me.root = child


@compiled
def only_child(ctx, node):
    """Return a node whose parent is this one; FREE without one."""
    state = state_at(ctx)
    for other in range(state.node_start.shape[0]):
        if state.node_start[other] != FREE and state.node_parent[other] == node:
            return other
    return FREE
