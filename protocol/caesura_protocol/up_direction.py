"""Direction of up: the unit vector in the base frame that points away from gravity.

(0, 0, 1) for an arm on a table, (0, 0, −1) for one that hangs from a ceiling; on a wall it lies in the plane
of the mounting face. The weight of a load points against it. Positions, forces and programs are in the
robot's base frame: only the estimation of weights uses the direction.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from types import MappingProxyType

from caesura_protocol.errors import MAX_SHOWN

Vector = tuple[float, float, float]

UP: Vector = (0.0, 0.0, 1.0)  # where none is stated
NORM_TOLERANCE = 1e-3  # by which the length of a direction may differ from 1
GRAVITY = 9.81  # [m/s²], as the thesis has it
NEAR_GRAVITY = 0.5  # [m/s²] by which the length of a vector differs that was meant as gravity
LEAST_SIZE = 1e-9  # of a vector whose direction is proposed; one that is longer than 1e9 has none either
ROUNDED = 1e-12  # by which the length differs once it was made 1
APART_RAD = math.radians(5.0)  # two bases that are tilted alike: a level shows less, a mounting more
WORDS = MappingProxyType(
    {
        f"{sign}{axis}": tuple((-1.0 if sign else 1.0) * (axis == one) + 0.0 for one in "xyz")
        for axis in "xyz"
        for sign in ("", "-")
    }
)
EXPECTED = f"three numbers x,y,z of length 1 ± {NORM_TOLERANCE:g}, or one of {', '.join(WORDS)}"


def checked_up(up: Sequence[float]) -> Vector:
    """Return the direction with length 1. Raises ValueError with the value, the limit and a remedy.

    A direction that this function has returned is returned unchanged, so that a repeated opening is equal.

    >>> checked_up((0.0, 0.0, -1.0)), checked_up((0.0, 0.0, 1.0005))
    ((0.0, 0.0, -1.0), (0.0, 0.0, 1.0))
    """
    if len(up) != len(UP) or not all(map(math.isfinite, up)):
        raise ValueError(f"up is {up_text(up)}, expected {EXPECTED}")
    size = math.hypot(*up)
    if abs(size - 1.0) > NORM_TOLERANCE:
        found = f"up is {up_text(up)} of length {size:.6g}, expected 1 ± {NORM_TOLERANCE:g}"
        raise ValueError(found + _remedy(up, size))
    size = 1.0 if abs(size - 1.0) < ROUNDED else size
    x, y, z = (value / size + 0.0 for value in up)
    return x, y, z


def _remedy(up: Sequence[float], size: float) -> str:
    """Return a proposal: the direction of a vector, or the opposite of a vector of gravity."""
    if not LEAST_SIZE < size < 1.0 / LEAST_SIZE:
        return ""
    along = _rounded(value / size for value in up)
    if abs(size - GRAVITY) < NEAR_GRAVITY:
        opposite = _rounded(-value / size for value in up)
        return (
            f": up points away from gravity: is it {opposite}? "
            f"It is {along} where these numbers point away already, as in UR's set_gravity"
        )
    return f": is it {along}?"


def _rounded(values: Iterable[float]) -> str:
    return ",".join(f"{value + 0.0:.6g}" for value in values)


def parse_up(text: str) -> Vector:
    """Parse a direction: an axis of the base such as `-z`, or three numbers. Raises ValueError.

    >>> parse_up("-z"), parse_up("0, 1, 0")
    ((0.0, 0.0, -1.0), (0.0, 1.0, 0.0))
    """
    bare = text.strip().strip("()[]")
    if (named := WORDS.get(bare.lower().removeprefix("+"))) is not None:
        return checked_up(named)
    try:
        numbers = [float(part) for part in re.split(r"[,;\s]+", bare.strip())]
    except ValueError:
        numbers = []
    if len(numbers) != len(UP):
        raise ValueError(f"up is {text[:MAX_SHOWN]!r}, expected {EXPECTED}")
    return checked_up(numbers)


def up_text(up: Sequence[float]) -> str:
    """Return a direction in the form of files and `--up`, with the shortest exact numbers.

    >>> up_text((0.0, 0.0, -1.0))
    '0,0,-1'
    """
    return ",".join(repr(value).removesuffix(".0") for value in (float(one) + 0.0 for one in up))


def up_in_words(up: Sequence[float]) -> str:
    """Return a direction as text: an axis of the base, or three numbers.

    >>> up_in_words((0.0, 0.0, -1.0)), up_in_words((0.0, 0.6, 0.8))
    ('-z of the base', '(0, 0.6, 0.8) in the base frame')
    """
    for word, axis in WORDS.items():
        if tuple(up) == axis:
            return f"{word} of the base"
    return f"({', '.join(f'{value:.4g}' for value in up)}) in the base frame"


def tilt_between(one: Vector | None, other: Vector | None) -> float:
    """Return the angle [rad] between two directions; None is (0, 0, 1).

    >>> round(math.degrees(tilt_between(None, (0.0, 0.0, -1.0))))
    180
    """
    a, b = one or UP, other or UP
    return 2.0 * math.asin(min(0.5 * math.dist(a, b), 1.0))
