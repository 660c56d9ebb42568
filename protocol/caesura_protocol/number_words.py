"""Numbers in messages: a message stays short, whatever number a sender states."""

from __future__ import annotations

LONG = 1e12  # from here on with an exponent; times of day are below it


def fixed(value: float, decimals: int) -> str:
    """A number with so many decimals; one of more than 12 digits before them has an exponent.

    >>> fixed(12.345, 1), fixed(-1e308, 2), fixed(float("nan"), 2)
    ('12.3', '-1e+308', 'nan')
    """
    return f"{value:.{decimals}f}" if abs(value) < LONG else f"{value:.3g}"
