"""Chooses the filter for a model set: the compiled one if possible, otherwise the reference."""

from __future__ import annotations

from caesura_service.changepoint.filter_interface import ChangepointFilter
from caesura_service.changepoint.filter_parameters import FilterParameters
from caesura_service.changepoint.hazard import Hazard
from caesura_service.changepoint.run_length_filter import RunLengthFilter
from caesura_service.changepoint.segment_model_set import SegmentModelSet
from caesura_service.numba_support import has_kernels


def make_filter(lattice: SegmentModelSet, hazard: Hazard, parameters: FilterParameters) -> ChangepointFilter:
    """Return a new filter: the compiled one, or `RunLengthFilter` without Numba or with a model that has no
    kernel.

    A third party's channel model has no compiled kernel, and needs none.
    """
    if not has_kernels():
        return RunLengthFilter(lattice, hazard, parameters)
    from caesura_service.changepoint.compiled_filter import CompiledRunLengthFilter, can_compile  # noqa: PLC0415

    made = CompiledRunLengthFilter if can_compile(lattice) else RunLengthFilter
    return made(lattice, hazard, parameters)


def prepare() -> None:
    """Compile the kernels that are not compiled yet, so that no session waits for it."""
    if has_kernels():
        from caesura_service.changepoint.compiled_filter import compile_now  # noqa: PLC0415

        compile_now()
