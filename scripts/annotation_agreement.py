"""Print how far two annotators of the same recordings agree.

    python scripts/annotation_agreement.py                      # data/real against data/real/second
    python scripts/annotation_agreement.py FIRST SECOND         # any two directories of *.ann.json

Boundaries: F1 of major points, one to one, within the larger of the two tolerances. A major point that lies
on an optional point of the other annotator is neither agreement nor disagreement. "strict" counts it as a
disagreement. median |Δt|: over all major points that pair within GATE_S; tolerances play no part.
Classes: Cohen's kappa (1960) of the classes every 10 ms, where both annotators give one.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from caesura_lab.ground_truth import SUFFIX, read_annotation
from caesura_protocol.errors import CaesuraError

FIRST = Path(__file__).resolve().parents[1] / "data" / "real"
SECOND = FIRST / "second"
GATE_S = 0.5  # within which two points may be the same event
STEP_S = 0.01  # of the comparison of classes
ROUNDING_S = 1e-9

Document = dict[str, Any]


class Agreement(NamedTuple):
    """Counts of one recording, or of several added up.

    hits: pairs of major points; lone: major points that the other annotator has not;
    excused: major points on an optional point of the other; apart_s: |Δt| of pairs within GATE_S [s];
    classes: (first, second) every STEP_S where both give a class; labelled: steps where at least one does.
    """

    hits: int
    lone: int
    excused: int
    apart_s: tuple[float, ...]
    classes: tuple[tuple[str, str], ...]
    labelled: int

    @property
    def f1(self) -> float:
        """Share of agreement among major points, 1 where there are none."""
        return _ratio(2 * self.hits, 2 * self.hits + self.lone)

    @property
    def strict_f1(self) -> float:
        """The same with every excused point as a disagreement."""
        return _ratio(2 * self.hits, 2 * self.hits + self.lone + self.excused)

    @property
    def median_s(self) -> float:
        """Median |Δt| [s], nan without a pair."""
        return float(np.median(self.apart_s)) if self.apart_s else float("nan")

    @property
    def kappa(self) -> float:
        """Cohen's kappa of the classes, nan where chance alone would agree fully or no step has two."""
        return kappa(self.classes)


def kappa(pairs: Sequence[tuple[str, str]]) -> float:
    """Return Cohen's kappa: (observed − chance) / (1 − chance) of the agreement in pairs of classes."""
    if not pairs:
        return float("nan")
    first, second = np.array(pairs).T
    chance = sum(float(np.mean(first == kind) * np.mean(second == kind)) for kind in set(first))
    observed = float(np.mean(first == second))
    return float("nan") if chance > 1 - ROUNDING_S else (observed - chance) / (1 - chance)


def compare(first: Document, second: Document) -> Agreement:
    """Compare two annotations of one recording."""
    one, other = _points(first, "major"), _points(second, "major")
    pairs = _pairs(one, other)
    paired = ({i for i, _ in pairs}, {j for _, j in pairs})
    left = [p for i, p in enumerate(one) if i not in paired[0]]
    right = [p for j, p in enumerate(other) if j not in paired[1]]
    excused = len(_pairs(left, _points(second, "optional"))) + len(_pairs(right, _points(first, "optional")))
    near = _pairs(one, other, gate_s=GATE_S)
    apart = tuple(_distance(one[i], other[j]) for i, j in near)
    both, labelled = _classes(first, second)
    return Agreement(len(pairs), len(left) + len(right) - excused, excused, apart, both, labelled)


def pooled(parts: Iterable[Agreement]) -> Agreement:
    """Add up the counts of several recordings."""
    rows = list(parts)
    return Agreement(
        sum(row.hits for row in rows),
        sum(row.lone for row in rows),
        sum(row.excused for row in rows),
        tuple(x for row in rows for x in row.apart_s),
        tuple(x for row in rows for x in row.classes),
        sum(row.labelled for row in rows),
    )


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole else 1.0


def _points(document: Document, level: str) -> list[Document]:
    return [point for point in document["changepoints"] if point["level"] == level]


def _distance(one: Document, other: Document) -> float:
    """Return the least distance [s] between the accepted times of two points."""
    times = ([point[key] for key in ("t", "t_alt") if key in point] for point in (one, other))
    first, second = times
    return float(min(abs(a - b) for a in first for b in second))


def _pairs(
    one: Sequence[Document], other: Sequence[Document], gate_s: float | None = None
) -> list[tuple[int, int]]:
    """Pair points one to one: as many as possible, then the nearest. gate_s: in place of the tolerances."""
    if not one or not other:
        return []
    distance = np.array([[_distance(a, b) for b in other] for a in one])
    gate = np.array([[max(a["tol"], b["tol"]) if gate_s is None else gate_s for b in other] for a in one])
    within = distance <= gate + ROUNDING_S
    gain = np.where(within, 1.0 - distance / (gate + ROUNDING_S) / (2 * (len(one) + len(other))), 0.0)
    rows, columns = linear_sum_assignment(gain, maximize=True)
    return [(int(i), int(j)) for i, j in zip(rows, columns, strict=True) if within[i, j]]


def _classes(first: Document, second: Document) -> tuple[tuple[tuple[str, str], ...], int]:
    """Return the classes at steps where both give one, and the number of steps where at least one does."""
    begin = max(first["window"][0], second["window"][0])
    end = min(first["window"][1], second["window"][1])
    times = np.arange(begin + STEP_S / 2, end, STEP_S)
    one, other = (_class_at(times, document) for document in (first, second))
    both = (one != "") & (other != "")
    pairs = tuple(zip(one[both].tolist(), other[both].tolist(), strict=True))
    return pairs, int(np.count_nonzero((one != "") | (other != "")))


def _class_at(times: NDArray[np.float64], document: Document) -> NDArray[np.str_]:
    found = np.full(times.shape, "", dtype="U16")
    for segment in document["segments"]:
        found[(segment["t0"] <= times) & (times < segment["t1"])] = segment["cls"]
    return found


def _row(name: str, agreement: Agreement) -> str:
    return (
        f"{name:22s} {agreement.hits:5d} {agreement.lone:5d} {agreement.excused:8d} {agreement.f1:6.2f} "
        f"{agreement.strict_f1:7.2f} {1e3 * agreement.median_s:8.0f} {len(agreement.classes) * STEP_S:8.1f} "
        f"{agreement.kappa:6.2f}"
    )


def _document(path: Path) -> Document:
    """Read an annotation as the judge accepts it. Raises TruthError."""
    read_annotation(path)
    content: Document = json.loads(path.read_text(encoding="utf-8"))
    return content


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table. Returns 1 where no recording is annotated twice."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("first", type=Path, nargs="?", default=FIRST)
    parser.add_argument("second", type=Path, nargs="?", default=SECOND)
    options = parser.parse_args(arguments)
    twice = sorted(
        path.name for path in options.second.glob(f"*{SUFFIX}") if (options.first / path.name).is_file()
    )
    if not twice:
        print(f"no *{SUFFIX} is both in {options.first} and in {options.second}", file=sys.stderr)
        return 1
    print(f"{'recording':22s} pairs  lone  excused     F1  strict  |Δt| ms  both [s]  kappa")
    parts = []
    for name in twice:
        parts.append(compare(_document(options.first / name), _document(options.second / name)))
        print(_row(name.removesuffix(SUFFIX), parts[-1]))
    print(_row("all", pooled(parts)))
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except CaesuraError as error:
        sys.exit(f"error: {error}")
