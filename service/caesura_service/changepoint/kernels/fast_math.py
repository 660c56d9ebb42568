"""Logarithm and exponential that a compiler can vectorise, to within two units in the last place.

A call of the C library processes one number at a time. The polynomials and reductions are those of FreeBSD's
msun (`e_log.c`, `e_exp.c`), without branches.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call, misc, call-arg"

import math

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from caesura_service.numba_support.decorators import compiled, inlined, reducing

LN2_HIGH = 6.93147180369123816490e-01
LN2_LOW = 1.90821492927058770002e-10
LOG2_E = 1.0 / math.log(2.0)
MANTISSA = (1 << 52) - 1
ONE_BITS = 1023 << 52
HALF_ROOT2_BITS = 0x3FE6A09E667F3BCD  # of √½: mantissas are taken from there to √2
SHIFTER = 1.5 * 2.0**52  # adding it rounds to a whole number, which then stands in the low bits
SHIFTER_BITS = 0x4338000000000000
WHOLE = 2.0**52
WHOLE_BITS = 0x4330000000000000
LEAST = -700.0  # exp of anything below is nothing


@intrinsic
def bits_of(_context, value):
    """Return the 64 bits of a floating-point number as an integer."""

    def generate(_context, builder, _signature, arguments):
        return builder.bitcast(arguments[0], ir.IntType(64))

    return types.int64(types.float64), generate


@intrinsic
def float_of(_context, bits):
    """Return the floating-point number with these 64 bits."""

    def generate(_context, builder, _signature, arguments):
        return builder.bitcast(arguments[0], ir.DoubleType())

    return types.float64(types.int64), generate


def _extreme(name):
    """Return a function for the larger or smaller of two numbers, neither nan, that a compiler can
    vectorise.
    """

    @intrinsic
    def extreme(_context, first, second):
        def generate(_context, builder, _signature, arguments):
            double = ir.DoubleType()
            function = builder.module.declare_intrinsic(
                name, [double], ir.FunctionType(double, [double, double])
            )
            return builder.call(function, arguments, fastmath=("nnan", "nsz"))

        return types.float64(types.float64, types.float64), generate

    return extreme


larger, smaller = _extreme("llvm.maxnum"), _extreme("llvm.minnum")


@inlined
def log(x):
    """Return the natural logarithm of a normal number above 0."""
    shifted = bits_of(x) + (ONE_BITS - HALF_ROOT2_BITS)
    exponent = float_of((shifted >> 52) | WHOLE_BITS) - (WHOLE + 1023.0)
    f = float_of((shifted & MANTISSA) + HALF_ROOT2_BITS) - 1.0
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    even = w * (3.999999999940941908e-01 + w * (2.222219843214978396e-01 + w * 1.531383769920937332e-01))
    odd = z * (
        6.666666666666735130e-01
        + w * (2.857142874366239149e-01 + w * (1.818357216161805012e-01 + w * 1.479819860511658591e-01))
    )
    half = 0.5 * f * f
    return exponent * LN2_HIGH - ((half - (s * (half + (even + odd)) + exponent * LN2_LOW)) - f)


@inlined
def exp_of_negative(x):
    """Return the exponential of a number of at most about 0; 0 below `LEAST`."""
    power, rest = exp_in_parts(max(x, LEAST))
    return power + power * rest if x >= LEAST else 0.0


@inlined
def share_missing(x):
    """Return 1 − exp(−x) of a number of at least 0, also accurate for small numbers."""
    power, rest = exp_in_parts(max(-x, LEAST))
    return (1.0 - power) - power * rest


@inlined
def exp_in_parts(x):
    """Return 2^k and exp(r) − 1 with x = k log 2 + r and |r| at most half a log 2."""
    shifted = x * LOG2_E + SHIFTER
    k = shifted - SHIFTER
    high = x - k * LN2_HIGH
    low = k * LN2_LOW
    r = high - low
    t = r * r
    c = r - t * (
        1.66666666666666019037e-01
        + t
        * (
            -2.77777777770155933842e-03
            + t
            * (
                6.61375632143793436117e-05
                + t * (-1.65339022054652515390e-06 + t * 4.13813679705723846039e-08)
            )
        )
    )
    return float_of(ONE_BITS + ((bits_of(shifted) - SHIFTER_BITS) << 52)), high - (low - (r * c) / (2.0 - c))


@compiled
def logarithms(values, n):
    """Replace each of the first n numbers by its logarithm."""
    for i in range(n):
        values[i] = log(values[i])


@compiled
def exponentials(values, peak, n):
    """Replace the first n numbers by exp(value − peak); no number exceeds the peak."""
    for i in range(n):
        values[i] = exp_of_negative(values[i] - peak)


@compiled
def log_sum_exp(values, n):
    """Return `evidence.log_sum_exp` of the first n numbers."""
    peak = largest_of(values, n)
    return peak if peak == -math.inf else peak + math.log(total_of_exponentials(values, peak, n))


@compiled
def shares_of(values, n):
    """Return `log_sum_exp`, and replace each number by its exponential's share of the sum, or by 0."""
    peak = largest_of(values, n)
    if peak == -math.inf:
        values[:n] = 0.0
        return peak
    exponentials(values, peak, n)
    total = total_of(values, n)
    for i in range(n):
        values[i] /= total
    return peak + math.log(total)


@reducing
def total_of(values, n):
    """Return the sum of the first n numbers."""
    total = 0.0
    for i in range(n):
        total += values[i]
    return total


@reducing
def total_of_exponentials(values, peak, n):
    """Return Σ exp(value − peak) of the first n numbers."""
    total = 0.0
    for i in range(n):
        total += exp_of_negative(values[i] - peak)
    return total


@reducing
def largest_of(values, n):
    """Return the largest of the first n numbers; -inf of none."""
    most = -math.inf
    for i in range(n):
        most = larger(most, values[i])
    return most
