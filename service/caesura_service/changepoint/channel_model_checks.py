"""Checks that a channel model, of Caesura or of a third party, has the properties that the filter requires.

Each check raises AssertionError if the model violates its property for the given observations. `mass` is a
measurement: it returns 1 for a model whose evidence is a density, that is the product of its predictive
densities.
"""

from __future__ import annotations

import gc
import io
import pickle
import sys
import tracemalloc
from collections.abc import Callable, Iterable, Sequence
from types import FrameType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from caesura_service.changepoint.channel_model import AXES, Channel, ChannelModel, ModelInput, Rows, select

Array = NDArray[np.float64]
NOWHERE = ModelInput(np.zeros(AXES), np.zeros(AXES))

EARLY, LATE = 20, 500  # observations between which nothing may grow
SPARE_BYTES = 2048  # what Python itself allocates now and then; a number an observation would be 4000
ROUNDING = 1e-10
BEFORE = 1  # the hypothesis that `mass` looks at starts after so many observations


def rows_after(model: ChannelModel, observations: Iterable[ModelInput], rows: Rows | None = None) -> Rows:
    """Return the rows of all hypotheses after some observations, starting from `rows`."""
    rows = model.empty() if rows is None else rows
    for observed in observations:
        rows = model.extend(rows, observed)
    return rows


def check_pure(model: ChannelModel, observations: Sequence[ModelInput]) -> None:
    """Check that a model neither changes nor keeps its arguments, and repeats its results bit for bit."""
    rows = model.empty()
    for observed in observations:
        _freeze(rows)
        _freeze((observed.position, observed.force))
        given = _bytes(rows)
        extended = model.extend(rows, observed)
        evidence = model.log_evidence(_freeze(extended))
        assert _bytes(rows) == given, "extend changes the rows it is given"
        assert evidence.shape == (len(rows[0]) + 1,), (
            f"evidence has shape {evidence.shape}, expected one a hypothesis"
        )
        for vector in (observed.position, observed.force):
            kept = any(np.shares_memory(array, vector) for array in extended)
            assert not kept, "rows keep the observation's own memory"
        assert _bytes(model.extend(rows, observed)) == _bytes(extended), "the same rows give other bits"
        assert _bytes([model.log_evidence(extended)]) == _bytes([evidence]), (
            "the same rows give other evidence"
        )
        rows = extended


def check_independent(model: ChannelModel, observations: Sequence[ModelInput]) -> None:
    """Check that the evidence of a hypothesis does not depend on other hypotheses."""
    *past, observed = observations
    rows = rows_after(model, past)
    count = len(rows[0])
    every = model.log_evidence(model.extend(rows, observed))
    for index in (*([i] for i in range(count)), range(0, count, 2), range(1, count)):
        some = model.log_evidence(model.extend(select(rows, np.array(index)), observed))
        np.testing.assert_allclose(some[:-1], every[np.array(index)], atol=ROUNDING, rtol=ROUNDING)


def check_serialisable(model: ChannelModel, observations: Sequence[ModelInput]) -> None:
    """Check that a model and its rows give the same bits after they are stored and loaded."""
    half = len(observations) // 2
    rows = rows_after(model, observations[:half])
    again, file = pickle.loads(pickle.dumps(model)), io.BytesIO()
    np.savez(file, *rows, allow_pickle=False)
    file.seek(0)
    with np.load(file) as stored:
        read = tuple(stored[name] for name in stored.files)
    assert _bytes(read) == _bytes(rows), "rows change when they are stored"
    ended, other = (
        rows_after(model, observations[half:], rows),
        rows_after(again, observations[half:], read),
    )
    assert _bytes(other) == _bytes(ended), "model and rows that were stored go on otherwise"
    assert _bytes([again.log_evidence(other)]) == _bytes([model.log_evidence(ended)]), "nor the same evidence"


def check_constant_work(model: ChannelModel, observations: Iterable[ModelInput]) -> None:
    """Check that a late observation takes no more memory, bytes of rows or lines run than an early one.

    observations: endless, or longer than `LATE`. Time is not measured.
    """
    rows, measured = model.empty(), []
    for n, observed in enumerate(observations):
        if n in (EARLY, LATE):
            measured.append(_work(model, rows, observed))
        if n == LATE:
            break
        rows = select(model.extend(rows, observed), np.array([0]))
    (size, lines, peak), (late_size, late_lines, late_peak) = measured
    assert late_size == size, f"rows grow from {size} to {late_size} bytes"
    assert late_lines == lines, f"a step runs {lines} lines early, {late_lines} late"
    assert late_peak <= peak + SPARE_BYTES, f"a step takes {peak} bytes early, {late_peak} late"


def everywhere(
    channel: Channel, centre: ArrayLike, scale: ArrayLike, *, nodes: int = 13, reach: float = 3.5
) -> tuple[list[ModelInput], Array]:
    """Return quadrature points in one channel's space, and the volume of each [unit³].

    They are dense within `scale` [unit] of the centre, and increasingly sparse up to scale · sinh(reach), for
    heavy tails; scale: (3,) or one number.
    """
    steps = np.linspace(-reach, reach, nodes)
    spread, width = np.sinh(steps), (steps[1] - steps[0]) * np.cosh(steps)
    scale = np.broadcast_to(np.asarray(scale, float), AXES)
    grid = np.stack(np.meshgrid(spread, spread, spread, indexing="ij"), -1).reshape(-1, AXES)
    volumes = np.einsum("i,j,k->ijk", width, width, width).ravel() * np.prod(scale)
    values = np.asarray(centre, float) + scale * grid
    return [NOWHERE._replace(**{channel: value}) for value in values], volumes


def mass(
    model: ChannelModel,
    past: Sequence[ModelInput],
    places: tuple[Sequence[ModelInput], Array],
    after: Sequence[ModelInput] = (),
) -> float:
    """Integrate the density of the next observation, given the past, over all places; 1 for a true density.

    past: its first observation precedes the segment, which starts with the second, or else with the next
    observation. places: the next observations, and the volume [unit³] of each (`everywhere`). after:
    observations that follow the next one; then the joint density of the next one and these is summed.
    """
    rows, known = rows_after(model, past), 0.0
    if len(past) > BEFORE:
        rows = select(rows, np.array([BEFORE]))
        known = float(model.log_evidence(rows)[0])
    mine = np.array([0 if len(past) > BEFORE else BEFORE])
    ahead = [select(model.extend(rows, place), mine) for place in places[0]]
    batch: Rows = tuple(np.concatenate(arrays) for arrays in zip(*ahead, strict=True))
    for observed in after:
        batch = select(model.extend(batch, observed), np.arange(len(ahead)))
    return float(places[1] @ np.exp(model.log_evidence(batch) - known))


def _work(model: ChannelModel, rows: Rows, observed: ModelInput) -> tuple[int, int, int]:
    """Run one step; return the bytes of its rows, the lines run, and the most bytes allocated."""

    def step() -> Rows:
        extended = model.extend(rows, observed)
        model.log_evidence(extended)
        return extended

    size = sum(array.nbytes for array in step())
    collecting = gc.isenabled()
    gc.disable()  # a collection in between would run others' callbacks, and be counted
    try:
        return size, _lines(step), _peak(step)
    finally:
        if collecting:
            gc.enable()


def _lines(step: Callable[[], object]) -> int:
    count = 0

    def trace(frame: FrameType, event: str, argument: Any) -> Any:
        nonlocal count
        count += event == "line"
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        step()
    finally:
        sys.settrace(before)
    return count


def _peak(step: Callable[[], object]) -> int:
    tracemalloc.start()
    try:
        step()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def _freeze(rows: Rows) -> Rows:
    for array in rows:
        array.flags.writeable = False
    return rows


def _bytes(rows: Iterable[NDArray[Any]]) -> list[tuple[str, tuple[int, ...], bytes]]:
    return [(array.dtype.str, array.shape, array.tobytes()) for array in rows]
