"""The number of counted and optional points a second in the truth of a suite.

    python -m caesura_lab.evaluation.truth_density teacher --seeds 12 --first-seed 4201

A simulated truth with fewer optional points than annotations of real recordings would make the judge
stricter.
"""

from __future__ import annotations

import sys
from argparse import ArgumentParser
from collections.abc import Iterable, Sequence

from caesura_lab.annotations import Truth
from caesura_lab.evaluation.suites import SUITES, SuiteOptions, suite


def density(truths: Iterable[Truth]) -> tuple[float, float]:
    """Return the number of counted and of optional points per second [1/s], over all windows together."""
    counted, optional, seconds = 0, 0, 0.0
    for truth in truths:
        first, last = truth.window
        seconds += last - first
        optional += sum(point.optional for point in truth.points)
        counted += sum(not point.optional for point in truth.points)
    return counted / seconds, optional / seconds


def main(arguments: Sequence[str]) -> None:
    """Print both numbers. Raises TruthError for an empty suite."""
    parser = ArgumentParser(description="Points a second in the truth of a suite.")
    parser.add_argument("suite", choices=sorted(SUITES))
    parser.add_argument("--seeds", type=int, default=5, help="People a scenario.")
    parser.add_argument("--first-seed", type=int, default=1)
    options = parser.parse_args(arguments)
    cases = suite(options.suite, SuiteOptions(seeds=options.seeds, first_seed=options.first_seed))
    counted, optional = density(case.load()[1] for case in cases)
    sys.stdout.write(f"{options.suite}: {counted:.2f} counted and {optional:.2f} optional points a second\n")


if __name__ == "__main__":
    main(sys.argv[1:])
