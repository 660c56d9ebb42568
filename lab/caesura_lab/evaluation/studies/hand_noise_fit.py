"""The errors of a guiding hand from step to step: likelihood of degrees of freedom, memory and noise.

    python -m caesura_lab.evaluation.studies.hand_noise_fit --data DIR

The movements are those of the open annotations: between two neighbouring boundaries, at a median speed of 7
mm/s or more, without the steps of a start and of a stop. Their steps have the model of `GuidedMotion`, and
every movement has one of its scales. No boundaries are inferred, so their accuracy has no influence.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from scipy.optimize import minimize

from caesura_lab.evaluation.baselines.conditioned_signals import Signals, grid_signals
from caesura_lab.evaluation.cases.suites import OPEN, SuiteOptions, suite
from caesura_lab.evaluation.reports.grids import Grid
from caesura_lab.ground_truth import Truth
from caesura_service.changepoint.channel_model import AXES
from caesura_service.changepoint.default_presets import guided_motion
from caesura_service.changepoint.evidence import log_mean_exp, student_log_density
from caesura_service.changepoint.preset import STEP_S

Array = NDArray[np.float64]

DEGREES = (1.0, 2.0, 3.0, 4.0, 5.0, 7.0, 10.0, 20.0, 100.0)
LEAST_M_PER_S = 0.007  # median speed of a movement
LEAST_STEPS = 7  # of a movement
BEGIN, END = 3, 3  # steps of a start, as of `GuidedMotion.burst_steps`, and of a stop
EVERY = "all"


@dataclass(frozen=True)
class HandNoise:
    """Parameters of `GuidedMotion`.

    floor [m] of a step; share of the speed; correlation ρ of one step; nu: degrees of freedom.
    """

    floor: float
    share: float
    correlation: float
    nu: float

    def log_likelihood(self, steps: Array) -> float:
        """Return the log likelihood of a movement's steps (n, 3) [m], without its start and stop."""
        before, earlier = steps[BEGIN - 1 : -END - 1], steps[BEGIN - 2 : -END - 2]
        errors = steps[BEGIN:-END] - 2.0 * self.correlation * before + self.correlation**2 * earlier
        scale2 = self.floor**2 + self.share**2 * (before**2).sum(axis=1)
        squared = (errors**2).sum(axis=1) / scale2
        each = [student_log_density(squared, AXES, self.nu, scale).sum() for scale in guided_motion().scales]
        return float(log_mean_exp(np.array(each)) - 0.5 * AXES * np.log(scale2).sum())


def movements(truth: Truth, signals: Signals) -> Iterator[Array]:
    """Yield the steps (n, 3) [m] of each movement of an annotated recording."""
    edges = [truth.window[0], *(point.t for point in truth.points if not point.optional), truth.window[1]]
    for first, last in pairwise(np.searchsorted(signals.t, edges)):
        steps = np.diff(signals.position_base[first:last], axis=0)
        if len(steps) < LEAST_STEPS:
            continue
        if np.median(np.linalg.norm(steps, axis=1)) >= LEAST_M_PER_S * STEP_S:
            yield steps


def best(steps: Sequence[Array], begin: HandNoise) -> HandNoise:
    """Return the parameters of largest likelihood, by Nelder and Mead."""

    def negative(logs: Array) -> float:
        floor, share, odds, nu = np.exp(logs)
        noise = HandNoise(floor, share, odds / (1.0 + odds), nu)
        return -sum(noise.log_likelihood(one) for one in steps)

    odds = begin.correlation / (1.0 - begin.correlation)
    start = np.log([begin.floor, begin.share, odds, begin.nu])
    floor, share, odds, nu = np.exp(minimize(negative, start, method="Nelder-Mead").x)
    return HandNoise(floor, share, odds / (1.0 + odds), nu)


def _by_set(data: Path) -> dict[str, list[Array]]:
    by_set: dict[str, list[Array]] = {EVERY: []}
    for case in suite("real", SuiteOptions(data=data)):
        recording, truth = case.load()
        found = list(movements(truth, grid_signals(recording)))
        by_set[EVERY] += found
        by_set.setdefault(case.group, []).extend(found)
    return by_set


def grids(by_set: dict[str, list[Array]]) -> list[Grid]:
    """Log likelihood by degrees of freedom, and the parameters of largest likelihood, set by set."""
    model = guided_motion()
    used = HandNoise(model.floor, model.share, model.correlation, model.nu)
    by_nu, parameters = [], []
    for name, steps in by_set.items():
        of_nu = [
            sum(HandNoise(used.floor, used.share, used.correlation, nu).log_likelihood(one) for one in steps)
            for nu in DEGREES
        ]
        count = sum(len(one) - BEGIN - END for one in steps)
        by_nu.append((name, str(len(steps)), str(count), *(f"{value - max(of_nu):.0f}" for value in of_nu)))
        found = best(steps, used)
        behind = sum(used.log_likelihood(one) - found.log_likelihood(one) for one in steps)
        memory_s = -STEP_S / np.log(found.correlation)
        shown = (f"{1000 * found.floor:.2f}", f"{found.share:.3f}", f"{memory_s:.2f}", f"{found.nu:.1f}")
        parameters.append((name, *shown, f"{behind:.0f}"))
    nus = tuple(f"ν = {nu:g}" for nu in DEGREES)
    headings = ("set", "floor [mm]", "share", "memory [s]", "ν", "default's [nats]")
    return [
        Grid("log likelihood behind the best [nats]", ("set", "movements", "steps", *nus), tuple(by_nu)),
        Grid("largest likelihood, and how far default's parameters are behind", headings, tuple(parameters)),
    ]


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=OPEN, help="the directory of the recordings")
    for grid in grids(_by_set(parser.parse_args().data)):
        Console().print(grid.as_text())


if __name__ == "__main__":
    main()
