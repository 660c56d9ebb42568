"""The density of counted and optional points in the truth of a suite, and the time that optional ones excuse.

    python -m caesura_lab.evaluation.studies.truth_point_rate teacher --seeds 12 --first-seed 4201
    python -m caesura_lab.evaluation.studies.truth_point_rate real --data DIR

A simulated truth with fewer optional points than annotations of real recordings would make the judge
stricter. The more time lies near optional points, the less a precision means.
"""

from __future__ import annotations

import sys
from argparse import ArgumentParser
from collections.abc import Iterable, Sequence
from pathlib import Path

from caesura_lab.evaluation.cases.suites import OPEN, SUITES, SuiteOptions, suite
from caesura_lab.evaluation.scoring.score import EDGE_S
from caesura_lab.ground_truth import ToleranceOptions, TrueChangepoint, Truth

SLACKS_S = (0.0, 0.2)


def density(truths: Iterable[Truth]) -> tuple[float, float]:
    """Return the number of counted and of optional points per second [1/s], over all windows together."""
    counted, optional, seconds = 0, 0, 0.0
    for truth in truths:
        first, last = truth.window
        seconds += last - first
        optional += sum(point.optional for point in truth.points)
        counted += sum(not point.optional for point in truth.points)
    return counted / seconds, optional / seconds


def near_points(truths: Iterable[Truth]) -> tuple[float, float]:
    """Return the shares of the judged time within tolerance of a counted point, and of an optional one alone.

    The judged time is that of all windows together, without their edges.
    """
    counted_s, any_s, judged_s = 0.0, 0.0, 0.0
    for truth in truths:
        inside = truth.window[0] + EDGE_S, truth.window[1] - EDGE_S
        judged_s += max(inside[1] - inside[0], 0.0)
        counted_s += _covered_s([point for point in truth.points if not point.optional], inside)
        any_s += _covered_s(truth.points, inside)
    return counted_s / judged_s, (any_s - counted_s) / judged_s


def _covered_s(points: Sequence[TrueChangepoint], inside: tuple[float, float]) -> float:
    """Return the time [s] of an interval that lies within tolerance of any of the points."""
    around = [(t - point.tolerance_s, t + point.tolerance_s) for point in points for t in point.accepted_s]
    total, reached = 0.0, inside[0]
    for low, high in sorted(around):
        end = min(high, inside[1])
        total += max(end - max(low, reached), 0.0)
        reached = max(reached, end)
    return total


def main(arguments: Sequence[str]) -> None:
    """Print all numbers. Raises TruthError for an empty suite."""
    parser = ArgumentParser(description="Points a second in the truth of a suite, and the time near them.")
    parser.add_argument("suite", choices=sorted(SUITES))
    parser.add_argument("--seeds", type=int, default=5, help="People a scenario.")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--data", type=Path, default=OPEN, help="Directory of real recordings.")
    options = parser.parse_args(arguments)
    extent = SuiteOptions(seeds=options.seeds, first_seed=options.first_seed, data=options.data)
    truths = [case.load()[1] for case in suite(options.suite, extent)]
    counted, optional = density(truths)
    sys.stdout.write(f"{options.suite}: {counted:.2f} counted and {optional:.2f} optional points a second\n")
    for slack_s in SLACKS_S:
        counted, optional = near_points(map(ToleranceOptions(slack_s).apply_to, truths))
        sys.stdout.write(
            f"{slack_s:g} s of slack: {counted:.0%} of the time is near a counted point, "
            f"{optional:.0%} near an optional one alone\n"
        )


if __name__ == "__main__":
    main(sys.argv[1:])
