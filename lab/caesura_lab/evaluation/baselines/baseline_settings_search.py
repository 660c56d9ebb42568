"""Chooses the settings of baselines on the simulated teacher; `chosen_settings` holds the result.

    python -m caesura_lab.evaluation.baselines.baseline_settings_search --seeds 20 --first-seed 500
    python -m caesura_lab.evaluation.baselines.baseline_settings_search --suite real --data DIR

The second command chooses them on the real recordings, in hindsight: what a baseline reaches at most where
its settings are fitted to what it is judged on.

Coordinate search: one field after the other takes the value of its grid with the best F1, until a round
changes nothing. F1 is pooled over all demonstrations, boundaries within 0.2 s and reading uncertainty. Ties
keep the earlier value, so the same demonstrations give the same settings.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from caesura_lab.evaluation.baselines import bocpd_baseline, chosen_settings, third_party_baselines
from caesura_lab.evaluation.baselines.chosen_settings import GaussianSettings, KernelSettings, StudentSettings
from caesura_lab.evaluation.baselines.conditioned_signals import Signals, grid_signals
from caesura_lab.evaluation.baselines.simple_baselines import boundaries_s
from caesura_lab.evaluation.cases.suites import OPEN, Case, SuiteOptions, suite
from caesura_lab.evaluation.scoring.metrics import f1
from caesura_lab.evaluation.scoring.score import FoundSegmentation, score
from caesura_lab.evaluation.worker_pool import each
from caesura_lab.ground_truth import ToleranceOptions, Truth

SLACK_S = 0.2
SEEDS, FIRST_SEED = 20, 500
WORKERS = 2
ROUNDS = 4  # at most

Starts = Callable[[Signals, Any], NDArray[np.intp]]
Demonstration = tuple[Signals, Truth]
SPREADS = (0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0, 1.5, 2.0)
SPEEDS = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02)
FORCES = (0.25, 0.5, 1.0, 2.0, 4.0)
WEIGHTS = (0.001, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0)
DEGREES = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0)
SEGMENTS_S = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 64.0)
LEAST_S = (0.1, 0.2, 0.3)


@dataclass(frozen=True)
class SettingsSearch:
    """Search of one baseline's settings: where it begins, and the values that each field may take.

    restarts: changes of the beginning; the search is repeated from each.
    """

    name: str
    starts: Starts
    begin: Any
    grid: Mapping[str, Sequence[Any]]
    restarts: Sequence[Mapping[str, Any]] = ({},)


@dataclass(frozen=True)
class ChosenSettings:
    """Result of a search: settings, their F1, how many settings were tried, and the F1 of those in use."""

    name: str
    settings: Any
    f1: float
    tried: int
    in_use_f1: float


SEARCHES = (
    SettingsSearch(
        "GAUSSIAN",
        bocpd_baseline.gaussian_log,
        GaussianSettings(),
        {
            "speed_spread": SPREADS,
            "force_spread": SPREADS,
            "mean_segment_s": SEGMENTS_S,
            "degrees": DEGREES,
            "floor_m_per_s": SPEEDS,
            "floor_n": FORCES,
            "mean_weight": WEIGHTS,
            "least_s": LEAST_S,
        },
        ({}, {"speed_spread": 0.2, "force_spread": 0.2}),
    ),
    SettingsSearch(
        "STUDENT",
        bocpd_baseline.student_speed,
        StudentSettings(),
        {
            "spread": SPREADS,
            "mean_segment_s": SEGMENTS_S,
            "degrees": DEGREES,
            "unit_m_per_s": SPEEDS,
            "mean_weight": WEIGHTS,
            "least_s": LEAST_S,
        },
        ({"scale": "log"}, {"scale": "linear", "unit_m_per_s": 0.01}),
    ),
    SettingsSearch(
        "KERNEL",
        third_party_baselines.kernel,
        KernelSettings(),
        {
            "penalty": (0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0),
            "gamma": (None, 0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0),
            "floor_m_per_s": (*SPEEDS, 0.05),
            "floor_n": FORCES,
            "least_s": LEAST_S,
        },
        ({"signals": "log"}, {"signals": "log", "gamma": 0.1}, {"signals": "vectors", "gamma": 0.1}),
    ),
)


def pooled_f1(starts: Starts, settings: Any, demonstrations: Sequence[Demonstration]) -> float:
    """Return the F1 of one baseline with these settings, pooled over demonstrations."""
    counts = np.zeros(3)
    for signals, truth in demonstrations:
        times = boundaries_s(signals, starts(signals, settings))
        one = score("", truth, FoundSegmentation(tuple(times.tolist())))
        counts += (one.hits, one.false_alarms, one.misses)
    return f1(*counts)


def choose(search: SettingsSearch, demonstrations: Sequence[Demonstration]) -> ChosenSettings:
    """Return the best settings of a baseline by coordinate search, also from those in use."""
    tried: dict[Any, float] = {}

    def rate(settings: Any) -> float:
        if settings not in tried:
            tried[settings] = pooled_f1(search.starts, settings, demonstrations)
        return tried[settings]

    in_use = getattr(chosen_settings, search.name)
    begins = [*(replace(search.begin, **restart) for restart in search.restarts), in_use]
    best = max((_descend(begin, search.grid, rate) for begin in begins), key=rate)
    return ChosenSettings(search.name, best, rate(best), len(tried), rate(in_use))


def _descend(settings: Any, grid: Mapping[str, Sequence[Any]], rate: Callable[[Any], float]) -> Any:
    for _ in range(ROUNDS):
        before = settings
        for field, values in grid.items():
            candidates = [settings, *(replace(settings, **{field: value}) for value in values)]
            settings = max(candidates, key=rate)
        if settings == before:
            break
    return settings


def demonstration_of(case: Case) -> Demonstration:
    """Return the conditioned signals of a case, and its truth with slack."""
    recording, truth = case.load()
    return grid_signals(recording), ToleranceOptions(slack_s=SLACK_S).apply_to(truth)


def lines(choices: Sequence[ChosenSettings]) -> Iterator[str]:
    """Yield the table of `chosen_settings`, one assignment per line."""
    for choice in choices:
        found = f"F1 {choice.f1:.3f}, the best of {choice.tried}; those in use: {choice.in_use_f1:.3f}"
        yield f"{choice.name} = {choice.settings!r}  # {found}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Choose all settings on a suite, the teacher where none is named, and print them."""
    parser = argparse.ArgumentParser(
        prog="python -m caesura_lab.evaluation.baselines.baseline_settings_search", description=__doc__
    )
    parser.add_argument("--suite", default="teacher", help="as in caesura evaluate (%(default)s)")
    parser.add_argument("--data", type=Path, default=OPEN, help="directory of real recordings (%(default)s)")
    parser.add_argument("--seeds", type=int, default=SEEDS, help="people a scenario (%(default)s)")
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED, help="the first of them (%(default)s)")
    parser.add_argument("--workers", type=int, default=WORKERS, help="processes (%(default)s)")
    chosen = parser.parse_args(arguments)
    extent = SuiteOptions(seeds=chosen.seeds, first_seed=chosen.first_seed, data=chosen.data)
    cases = suite(chosen.suite, extent)
    demonstrations = list(each(demonstration_of, cases, workers=chosen.workers))
    demonstrations.sort(key=lambda one: one[1].name)
    work = partial(choose, demonstrations=demonstrations)
    choices = sorted(each(work, SEARCHES, workers=chosen.workers), key=lambda one: one.name)
    print("\n".join(lines(choices)))


if __name__ == "__main__":
    main()
