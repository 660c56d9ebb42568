"""The compiled filter: the results of `RunLengthFilter`, computed many times faster.

The same observations give the same state, bit for bit. It agrees with the reference, `RunLengthFilter`, to
1e-9. The reference is used for a model set with a model that `kernels` does not implement.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.channel_model import ModelInput
from caesura_service.changepoint.evidence_window import FinalPath, PathSegment, Starts
from caesura_service.changepoint.filter_parameters import FilterParameters
from caesura_service.changepoint.hazard import Geometric, Hazard
from caesura_service.changepoint.kernels import steps
from caesura_service.changepoint.kernels.array_tuple import table_of
from caesura_service.changepoint.kernels.layout import (
    FORCE,
    FREE,
    HOLDING,
    ROTATION,
    TORSION,
    Model,
    State,
    fresh_state,
    with_more_nodes,
)
from caesura_service.changepoint.kernels.model_set_conversion import (
    can_compile,
    fields_of,
    model_of,
    profiled_of,
)
from caesura_service.changepoint.random_walk import StudentRandomWalk
from caesura_service.changepoint.run_length_filter import check_finite, check_start
from caesura_service.changepoint.segment_model_set import SegmentKind, SegmentModelSet
from caesura_service.changepoint.smoothed_probabilities import RunLengthFilterBase, SmoothedProbabilities

Array = NDArray[np.float64]

__all__ = ["CompiledRunLengthFilter", "can_compile", "compile_now"]

FIRST_LENGTHS = 64  # samples of a segment that the tables reach at first


class CompiledRunLengthFilter(SmoothedProbabilities):
    """`RunLengthFilter` with compiled kernels. Raises ValueError for a lattice that cannot be compiled."""

    def __init__(
        self, lattice: SegmentModelSet, hazard: Hazard, parameters: FilterParameters | None = None
    ) -> None:
        if not can_compile(lattice):
            raise ValueError(f"no compiled twin for one of {[*lattice.channels]}, use RunLengthFilter")
        self.lattice = lattice
        self.hazard = hazard
        self.parameters = parameters or FilterParameters()
        self.count = 0
        self.final = FinalPath(len(lattice.kinds))
        self.boundaries: list[int] = []
        self._smoothing = RunLengthFilterBase()
        model = model_of(lattice, hazard, self.parameters, FIRST_LENGTHS)
        sizes = len(lattice.kinds), len(lattice.log_transition), len(lattice.channels), fields_of(lattice)
        self._keep(model, fresh_state(model.settings, *sizes, profiled_of(lattice)))
        self._room = 0  # steps until it has to be looked whether tables and nodes suffice

    def step(self, observed: ModelInput, boundary: bool = False, *, changepoint: bool | None = None) -> None:
        """Process one observation. boundary: whether it follows a gap, so that it begins an unconnected
        segment.

        changepoint: whether a segment starts at it, if known. Raises ValueError if a value is not finite, and
        then changes nothing.
        """
        now = self._state.now
        now[:FORCE], now[FORCE:ROTATION], now[HOLDING], now[ROTATION:TORSION], now[TORSION:HOLDING] = observed
        if not self._room:
            self._make_room()
        known = steps.UNKNOWN if changepoint is None else int(changepoint)
        after_gap = bool(boundary and self.count)
        settled, certain = steps.step(self._here, after_gap, known)
        if certain == steps.REFUSED:
            check_finite(observed, self.count)
        self._room -= 1
        if after_gap:
            self.boundaries.append(self.count)
        self.count += 1
        window = self._state.smoothed[: self.count]
        self._smoothing.leave(self._left if self.count > self.parameters.window else (), window)
        if settled:
            self._settle()
        if certain >= 0:
            self.condition_on_start(certain)

    def condition_on_start(self, start: int) -> None:
        """Condition on a segment that starts at observation `start`; the segments before it become final.

        Raises ValueError for a start that is final already, or out of the window.
        """
        check_start(start, self.root, self.count, self.parameters)
        self._smoothing.decide(start)
        self._make_room()
        steps.condition_on_start(self._here, start)
        self._settle()
        self._room = 0

    @property
    def root(self) -> int:
        """The latest start from which all living hypotheses descend."""
        return int(self._state.node_start[self._state.counters["root"][0]])

    @property
    def capped(self) -> int:
        """The number of steps on which the cap dropped hypotheses."""
        return int(self._state.counters["capped"][0])

    @property
    def starts(self) -> Starts:
        """(h,) starts of the living hypotheses, ascending."""
        return self._state.starts[: self._living].copy()

    @property
    def kind_log_evidence(self) -> Array:
        """(h, kinds) log evidence of each kind."""
        return self._state.kinds[:, : self._living].T.copy()

    @property
    def log_evidence(self) -> Array:
        """(h, groups) log evidence over the kinds of each group, to the power of the lattice."""
        return self._state.evidence[:, : self._living].T.copy()

    @property
    def log_joint(self) -> Array:
        """(h,) log joint probability of each hypothesis and all observations so far."""
        return self._state.joint[: self._living].copy()

    def map_path(self) -> list[PathSegment]:
        """The segments of the best segmentation from the root on, oldest first; the last is still growing."""
        state = self._state
        best, group = steps.best_pair(self._here)
        node, root = int(state.nodes[group, best]), int(state.counters["root"][0])
        before = int(state.node_group[node])
        path = [PathSegment(int(state.starts[best]), state.kinds[:, best].copy(), group, before)]
        while node not in (root, FREE):
            parent, group = int(state.node_parent[node]), before
            before = int(state.node_group[parent])
            start = int(state.node_start[parent])
            path.append(PathSegment(start, state.node_kinds[node].copy(), group, before))
            node = parent
        return path[::-1]

    def outline(self) -> list[tuple[int, int]]:
        """Return (start, number of the kind) for each segment of `map_path`, oldest first."""
        count = steps.write_segmentation(self._here, self._path)
        return [(start, kind) for start, kind in self._path[count - 1 :: -1].tolist()]

    @property
    def _living(self) -> int:
        """The number of living hypotheses, which occupy the first places."""
        return int(self._state.counters["living"][0])

    def _keep(self, model: Model, state: State) -> None:
        """Use this model and state from now on."""
        self._model, self._state, self._table = model, state, table_of(model, state)
        self._here, self._left = self._table.ctypes.data, state.counters["left"]
        self._path = np.zeros((state.node_start.size + 1, 2), np.int64)  # scratch

    def _settle(self) -> None:
        """Append the segments that the last step or condition made final to `final`."""
        count = self._state.counters["settled"][0]
        state = self._state
        settled = (getattr(state, f"settled_{name}")[:count] for name in ("start", "kinds", "group"))
        self.final.extend(
            PathSegment(int(s), kinds, int(group)) for s, kinds, group in zip(*settled, strict=True)
        )

    def _make_room(self) -> None:
        """Grow tables and nodes so that they suffice for `_room` steps, each followed by a condition."""
        spare, each = self.parameters.window + 2, len(self.lattice.log_transition) + 1
        while self._state.node_start.size < self._state.counters["nodes"][0] + 2 * spare * each:
            self._keep(self._model, with_more_nodes(self._state))
        nodes = (self._state.node_start.size - int(self._state.counters["nodes"][0])) // each - spare
        longest = self.count - int(self._state.starts[0]) if self._living else 0
        reach = self._model.log_mass.shape[1]
        if longest + 2 * spare > reach:
            longer = model_of(self.lattice, self.hazard, self.parameters, 2 * (longest + 2 * spare))
            self._keep(longer, self._state)
            reach = self._model.log_mass.shape[1]
        self._room = min(nodes, reach - longest - 3)


def compile_now() -> None:
    """Compile all kernels, or load them from the cache. All lattices share them."""
    still = StudentRandomWalk("position", scale=1.0)
    lattice = SegmentModelSet({"still": still}, (SegmentKind("steady", "steady", "free", ("still",)),))
    small = CompiledRunLengthFilter(lattice, Geometric(10.0), FilterParameters(window=2, certain=1.0))
    for _ in range(3):
        small.step(ModelInput(np.zeros(3), np.zeros(3)))
    small.outline()
    small.map_path()
    small.condition_on_start(2)
