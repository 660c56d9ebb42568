"""Formats numbers in messages: short for any number that a sender states, and with correct plurals."""

from __future__ import annotations

LONG = 1e12  # from here on with an exponent; times of day are below it
HISSING = ("s", "x", "ch", "sh")  # ends of nouns whose plural has a syllable more


def counted(number: int, noun: str) -> str:
    """Return a number with a noun, in the plural unless it is 1. noun: in the singular.

    >>> counted(1, "gap"), counted(0, "via point"), counted(2, "batch")
    ('1 gap', '0 via points', '2 batches')
    """
    if number == 1:
        return f"1 {noun}"
    return f"{number} {noun}{'es' if noun.endswith(HISSING) else 's'}"


def fixed(value: float, decimals: int) -> str:
    """Return a number with `decimals` decimals; with more than 12 digits before them, with an exponent.

    A zero has no sign.

    >>> fixed(12.345, 1), fixed(-0.04, 1), fixed(-1e308, 2), fixed(float("nan"), 2)
    ('12.3', '0.0', '-1e+308', 'nan')
    """
    return f"{value:z.{decimals}f}" if abs(value) < LONG else f"{value:.3g}"


def reads_above(value: float, limit: float, decimals: int) -> bool:
    """Return whether a number exceeds a limit by more than the rounding of the displayed values.

    >>> reads_above(2.0039, 2.0, 1), reads_above(1.951, 1.949, 1), reads_above(2.06, 2.0, 1)
    (False, False, True)
    """
    rounding = 0.5 * 10.0**-decimals
    return value - limit > rounding and fixed(value, decimals) != fixed(limit, decimals)


def interval(first: float, last: float, decimals: int, between: str = "–") -> str:
    """Return two numbers as a range, or one number if both have the same text.

    >>> interval(6.5, 7.25, 1), interval(6.5, 7.25, 1, " to "), interval(6.5, 6.52, 1)
    ('6.5–7.2', '6.5 to 7.2', '6.5')
    """
    return between.join(dict.fromkeys((fixed(first, decimals), fixed(last, decimals))))
