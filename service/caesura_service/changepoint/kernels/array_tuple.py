"""Passes a tuple of arrays to compiled code as one argument.

Numba unpacks each array argument of a call, which for the forty arrays of a step took a fifth of its time. So
a step gets a table of their addresses and shapes, and rebuilds them.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call, misc, attr-defined"

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array
from numpy.typing import NDArray

from caesura_service.changepoint.kernels.layout import A_MODEL, A_STATE

WORDS = 6  # of an array in the table: where it is, and how long along each dimension


def table_of(*tuples: NamedTuple) -> NDArray[np.int64]:
    """Return (arrays, words) address and shape of each array; valid while the contiguous arrays exist."""
    arrays = [array for arrays in tuples for array in arrays]
    table = np.zeros((len(arrays), WORDS), np.int64)
    for row, array in zip(table, arrays, strict=True):
        if not array.flags.c_contiguous:
            raise ValueError(f"strides are {array.strides} for {array.shape}, expected a contiguous array")
        row[: 1 + array.ndim] = array.ctypes.data, *array.shape
    return table


def unpacker(example: NamedTuple, skipped: int = 0) -> Callable[..., Any]:
    """Return a compiled function from the address of a table to a tuple of arrays with the types of the
    example's.

    skipped: number of arrays in the table before them. Unused arrays of the tuple cost nothing.
    """
    made = numba.typeof(example)

    @intrinsic
    def unpacked(_context, ctx):
        def generate(context, builder, signature, arguments):
            words = builder.inttoptr(arguments[0], ir.IntType(64).as_pointer())

            def word(i):
                return builder.load(builder.gep(words, [context.get_constant(types.intp, i)]))

            arrays = []
            for i, kind in enumerate(made.types, start=skipped):
                array = make_array(kind)(context, builder)
                size = context.get_abi_sizeof(context.get_data_type(kind.dtype))
                strides = [context.get_constant(types.intp, size)]
                shape = [word(WORDS * i + 1 + d) for d in range(kind.ndim)]
                for length in shape[:0:-1]:
                    strides.insert(0, builder.mul(strides[0], length))
                address = builder.inttoptr(word(WORDS * i), array.data.type)
                populate_array(array, address, shape, strides, strides[-1], None)
                arrays.append(array._getvalue())
            return context.make_tuple(builder, made, arrays)

        return made(types.int64), generate

    return unpacked


model_at, state_at = unpacker(A_MODEL), unpacker(A_STATE, len(A_MODEL))
