"""What really happened, read from annotations: by eye for real recordings, from the state for simulated ones.

A recording `x.npz` has its truth beside it in `x.ann.json`. Points of level `major` must be found; `optional`
ones count neither as a miss nor as a false alarm. Spans stand only where the class is clear.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

KINDS = ("motion", "steady", "contact", "transport", "hold", "sliding")
LEVELS = ("major", "optional")
SUFFIX = ".ann.json"


class TruthError(ValueError):
    """There is no truth to judge by; the message names the file, the value and what was expected."""


@dataclass(frozen=True)
class Point:
    """A boundary at t [s], known to within tolerance_s; kind says what happens (start, contact_on, …)."""

    t: float
    tolerance_s: float
    optional: bool = False
    kind: str = "boundary"


@dataclass(frozen=True)
class Span:
    """A stretch [s] of one class; kind is one of `KINDS`."""

    t0: float
    t1: float
    kind: str


@dataclass(frozen=True)
class Quantity:
    """A load [kg] or a force [N] that held from t0 to t1 [s]."""

    t0: float
    t1: float
    value: float


@dataclass(frozen=True)
class Truth:
    """The truth of one recording. Nothing outside of the window [s] is judged."""

    name: str
    window: tuple[float, float]
    points: tuple[Point, ...]
    spans: tuple[Span, ...] = ()
    loads: tuple[Quantity, ...] = ()
    forces: tuple[Quantity, ...] = ()
    hand_in_wrench: bool = False


@dataclass(frozen=True)
class Leniency:
    """How much more than reading uncertainty is allowed: slack_s [s] is added, least_s [s] is the least."""

    slack_s: float = 0.0
    least_s: float = 0.0

    def of(self, truth: Truth) -> Truth:
        """The truth with every point's tolerance widened."""
        points = (
            replace(point, tolerance_s=max(point.tolerance_s + self.slack_s, self.least_s))
            for point in truth.points
        )
        return replace(truth, points=tuple(points))


def truth_file(recording: Path) -> Path:
    """Where the truth of a recording stands: `x.npz` → `x.ann.json`."""
    return recording.with_suffix(SUFFIX)


def read_truth(recording: Path) -> Truth:
    """Read the truth beside a recording. Raises TruthError where there is none, or none that can be read."""
    path = truth_file(recording)
    if not path.is_file():
        raise TruthError(f"{recording}: not annotated, expected its truth in {path}")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise TruthError(f"{path}: not a readable annotation ({error})") from error
    return truth_of(content, str(path))


def truth_of(content: Mapping[str, Any], name: str) -> Truth:
    """The truth in an annotation's content. Raises TruthError naming the value that is off."""
    try:
        return Truth(
            name=name,
            window=_window(content["window"]),
            points=tuple(sorted(map(_point, content["changepoints"]), key=lambda point: point.t)),
            spans=tuple(map(_span, content.get("segments", ()))),
            loads=_quantities(content.get("loads", ()), "kg"),
            forces=_quantities(content.get("forces", ()), "newton"),
            hand_in_wrench=bool(content.get("hand_force_in_wrench", False)),
        )
    except KeyError as error:
        raise TruthError(f"{name}: {error.args[0]!r} is missing") from error
    except (TypeError, ValueError, AttributeError) as error:
        raise TruthError(f"{name}: {error}") from error


def _window(values: Any) -> tuple[float, float]:
    first, last = map(float, values)
    if not first < last:
        raise ValueError(f"window is [{first:g}, {last:g}], expected it to have a length")
    return first, last


def _point(mark: Mapping[str, Any]) -> Point:
    level = mark["level"]
    if level not in LEVELS:
        raise ValueError(f"level is {level!r}, expected one of {list(LEVELS)}")
    tolerance = float(mark["tol"])
    if not tolerance >= 0.0:
        raise ValueError(f"tol is {tolerance}, expected 0 s or more")
    return Point(float(mark["t"]), tolerance, level == "optional", str(mark.get("kind", level)))


def _span(segment: Mapping[str, Any]) -> Span:
    kind = segment["cls"]
    if kind not in KINDS:
        raise ValueError(f"cls is {kind!r}, expected one of {list(KINDS)}")
    return Span(float(segment["t0"]), float(segment["t1"]), kind)


def _quantities(entries: Any, unit: str) -> tuple[Quantity, ...]:
    return tuple(Quantity(float(e["t0"]), float(e["t1"]), float(e[unit])) for e in entries)
