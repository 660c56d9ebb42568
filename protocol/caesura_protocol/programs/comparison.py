"""Compares two programs app by app; returns the differences in both directions as text.

`differences` compares a program with an earlier version of itself, `compared` any two, pair by pair.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.app_kinds import app_number, name_of_app
from caesura_protocol.messages import App, Vector
from caesura_protocol.number_words import fixed
from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.rotations import angle_between
from caesura_protocol.up_direction import up_text

ALONE, FAR_M = 0.7, 0.1  # cost of an app that only one has; targets this far apart cost 1
ELSEWHERE = (
    1e-4  # cost of a pair at the two ends of the programs: of equal pairs, those at like places correspond
)
TIE = 1e-9  # costs that differ by less are equal: they are sums in different orders


class LeastDifferences(NamedTuple):
    """Least differences that count: by unit, and as a share of the larger value.

    opening_m: of the gripper's fingers, without the share: what they hold has the same width each time.
    """

    metres: float
    radians: float
    newtons: float
    seconds: float
    kilograms: float
    factor: float
    path_m: float
    opening_m: float
    share: float = 0.0


ROUNDING = LeastDifferences(1e-4, math.radians(0.1), 0.05, 0.005, 0.005, 0.005, 1e-3, 1e-4)
REPETITION = LeastDifferences(
    0.005, math.radians(5.0), 1.0, 0.3, 0.05, 0.05, 0.01, 0.002, share=0.15
)  # of one task


class FieldDifference(NamedTuple):
    """A differing value as text; apart: the size of the difference, if it is clearer than the two values."""

    what: str
    one: str
    other: str
    apart: str = ""

    def words(self, between: str) -> str:
        """Return the difference as text. between: text between the two values."""
        return self.apart or f"{self.what} {self.one}{between}{self.other}"


class AppPair(NamedTuple):
    """Corresponding apps of two programs, by index, None if only one has it.

    With their differences as text.
    """

    one: int | None
    other: int | None
    words: tuple[str, ...] = ()


def differences(one: ProgramFile, other: ProgramFile) -> list[str]:
    """Return the differences of a program from an earlier one, app by app; none for equal ones.

    A value belongs to the program itself, and one after `was` to the earlier one.
    """
    found = [f"program: {words}" for words in _of_programs(one, other)]
    for first, second, words in compared(one.apps, other.apps):
        if second is None and first is not None:
            found.append(f"{name_of_app(first, one.apps[first])} is added")
        elif first is None and second is not None:
            found.append(f"without what was {name_of_app(second, other.apps[second])}")
        elif first is not None and second is not None and words:
            before = "" if first == second else f", was app {app_number(second)}"
            found.append(f"{name_of_app(first, one.apps[first])}{before}: {'; '.join(words)}")
    return found


def compared(
    apps: Sequence[App], others: Sequence[App], least: LeastDifferences = ROUNDING, between: str = ", was "
) -> list[AppPair]:
    """Return all apps of both programs, each with its counterpart; between: text between two values."""
    return [
        AppPair(i, j, () if i is None or j is None else tuple(_words(apps[i], others[j], least, between)))
        for i, j in _pairs(apps, others)
    ]


def _words(one: App, other: App, least: LeastDifferences, between: str) -> list[str]:
    return [difference.words(between) for difference in field_differences(one, other, least)]


def _pairs(apps: Sequence[App], others: Sequence[App]) -> list[tuple[int | None, int | None]]:
    """Return the corresponding apps, in order, at the least cost; None for an app without a counterpart.

    This is an edit distance: a pair of one kind costs the distance of its targets, a single app `ALONE`. A
    row of costs is computed at once: a step to the right costs ALONE, so the least is a running minimum.
    """
    steps = ALONE * np.arange(len(others) + 1)
    is_pair = np.zeros((len(apps) + 1, len(others) + 1), dtype=bool)
    is_alone = np.zeros_like(is_pair)
    is_alone[1:, 0] = True
    cost, places = steps, _Places(others)
    shares = (np.arange(len(others)) + 0.5) / max(len(others), 1)  # (n,) of the way through the program
    for i, app in enumerate(apps, start=1):
        alone = cost + ALONE
        elsewhere = ELSEWHERE * np.abs((i - 0.5) / len(apps) - shares)
        together = np.append(np.inf, cost[:-1] + places.apart(app) + elsewhere)
        cost = steps + np.minimum.accumulate(np.minimum(alone, together) - steps)
        is_pair[i], is_alone[i] = together <= cost + TIE, alone <= cost + TIE
    i, j = len(apps), len(others)
    pairs: list[tuple[int | None, int | None]] = []
    while i or j:
        if is_pair[i, j]:
            i, j = i - 1, j - 1
            pairs.append((i, j))
        elif is_alone[i, j]:
            i -= 1
            pairs.append((i, None))
        else:
            j -= 1
            pairs.append((None, j))
    return pairs[::-1]


class _Places:
    """Kinds and targets of several apps, for comparison with one app."""

    def __init__(self, apps: Sequence[App]) -> None:
        nowhere = (math.nan,) * 3
        self._kinds = np.array([app.kind for app in apps], dtype=str)
        self._targets = np.array([app.target or nowhere for app in apps]).reshape(-1, 3)  # (n, 3) [m]
        self._has_target = np.array([app.target is not None for app in apps], dtype=bool)

    def apart(self, app: App) -> NDArray[np.float64]:
        """Return (n,) the cost of pairing each with the app.

        It is 0 for the same target, infinite for another kind.
        """
        if app.target is None:
            cost = self._has_target.astype(np.float64)
        else:
            far = np.linalg.norm(self._targets - app.target, axis=1) / FAR_M
            cost = np.where(self._has_target, np.minimum(far, 1.0), 1.0)
        return np.where(self._kinds == app.kind, cost, np.inf)


def _of_programs(one: ProgramFile, other: ProgramFile) -> Iterator[str]:
    for what, mine, others in (
        ("name", one.name, other.name),
        ("robot", one.robot, other.robot),
        ("up", one.up and up_text(one.up), other.up and up_text(other.up)),
        ("force limit [N]", one.safety.force_n, other.safety.force_n),
    ):
        if mine != others:
            yield f"{what} {_or_none(mine)}, was {_or_none(others)}"


def field_differences(one: App, other: App, least: LeastDifferences = ROUNDING) -> list[FieldDifference]:
    """Return the values in which two apps differ."""
    return [*_of_texts(one, other), *_of_poses(one, other, least), *_of_numbers(one, other, least)]


def _of_texts(one: App, other: App) -> Iterator[FieldDifference]:
    for what, text, before in (
        ("name", one.name, other.name),
        ("note", one.note, other.note),
        ("position name", one.target_name, other.target_name),
    ):
        if text != before:
            yield FieldDifference(what, _or_none(text), _or_none(before))


def _of_numbers(one: App, other: App, least: LeastDifferences) -> Iterator[FieldDifference]:
    for what, value, field, unit, scale in _NUMBERS:
        mine, others = value(one), value(other)
        share = 0.0 if field == "opening_m" else least.share
        if _differ(mine, others, getattr(least, field), share):
            yield FieldDifference(what, _number(mine, unit, scale), _number(others, unit, scale))


def _differ(one: float | None, other: float | None, least: float, share: float) -> bool:
    if one is None or other is None:
        return one is not other
    return one != other and abs(one - other) >= max(least, share * max(abs(one), abs(other)))


def _of_poses(one: App, other: App, least: LeastDifferences) -> Iterator[FieldDifference]:
    targets = _place(one.target), _place(other.target)
    if one.target is not None and other.target is not None:
        apart = math.dist(one.target, other.target)
        if apart >= least.metres:
            yield FieldDifference("target", *targets, f"target {fixed(1000 * apart, 1)} mm away")
    elif one.target != other.target:
        yield FieldDifference("target", *targets, "target given" if one.target else "no target any more")
    if one.orientation is not None and other.orientation is not None:
        turned = angle_between(one.orientation, other.orientation)
        if turned >= least.radians:
            words = f"turned by {math.degrees(turned):.1f}°"
            yield FieldDifference("orientation", "", "", words)


def _place(target: Vector | None) -> str:
    """Return a target as text.

    >>> _place((0.3, -0.00001, 0.25))
    '(300.0, 0.0, 250.0) mm'
    """
    if target is None:
        return "none"
    return f"({', '.join(fixed(round(1000 * value, 1) + 0.0, 1) for value in target)}) mm"


def _size(app: App) -> float | None:
    return None if app.force is None else math.hypot(*app.force)


_Number = tuple[str, Callable[[App], float | None], str, str, float]  # with its least difference, unit, scale
_NUMBERS: Sequence[_Number] = (
    ("force", _size, "newtons", "N", 1.0),
    ("duration", lambda app: app.tn - app.t0, "seconds", "s", 1.0),
    ("speed", lambda app: app.speed or 1.0, "factor", "%", 100.0),
    ("gripper width", lambda app: app.gripper_width, "opening_m", "mm", 1000.0),
    ("load", lambda app: app.load_kg, "kilograms", "kg", 1.0),
    ("path", lambda app: None if app.path is None else app.path.length_m, "path_m", "mm", 1000.0),
    ("tolerance", lambda app: None if app.path is None else app.path.tolerance_m, "metres", "mm", 1000.0),
)


def _number(value: float | None, unit: str, scale: float) -> str:
    """Return a value as text, a length to a tenth of a millimetre like targets.

    >>> _number(0.002999, "mm", 1000.0), _number(1.2891, "s", 1.0)
    ('3 mm', '1.289 s')
    """
    if value is None:
        return "not given"
    return f"{round(scale * value, 1 if unit == 'mm' else 3):.4g} {unit}"


def _or_none(value: object) -> str:
    return "none" if value is None else f"{value}" if isinstance(value, float) else f"'{value}'"
