"""Selects the implementation of conditioning: compiled if numba is available, else NumPy."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import ModuleType
from typing import NamedTuple

from caesura_service.numba_support import has_kernels
from caesura_service.signals import numpy_operations


class Backend(NamedTuple):
    """The operations of `numpy_operations`, in NumPy or compiled."""

    copy_columns: Callable[..., bool]
    is_steady: Callable[..., bool]
    make_sign_continuous: Callable[..., None]
    interpolate_holds: Callable[..., float]
    resample: Callable[..., None]
    flange_rows: Callable[..., None]
    openings: Callable[..., float]
    fit_polynomials: Callable[..., float]
    speeds_of: Callable[..., None]
    boundary_row: Callable[..., int]
    subtract_bias_and_normalise: Callable[..., None]


def _named_in(module: ModuleType) -> Backend:
    return Backend(*(getattr(module, name) for name in Backend._fields))


REFERENCE = _named_in(numpy_operations)


@cache
def best() -> Backend:
    """Return the compiled operations if kernels are available, else the reference."""
    if not has_kernels():
        return REFERENCE
    from caesura_service.signals.kernels import compiled_operations  # noqa: PLC0415

    return _named_in(compiled_operations)
