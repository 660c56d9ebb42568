"""Other people's detectors, on the model class that they have: a level that changes, with Gaussian noise.

`changepoint` (Rust) and bayesian-changepoint-detection keep every run length; ours is pruned, and shown
unpruned beside it. What is not installed is left out: `pip install -c constraints.txt '.[bench]'` has them
all.
"""

from __future__ import annotations

import statistics
import sys
import time
import types
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import scipy.special
from numpy.typing import NDArray

from caesura_service.changepoint.channel_model import ModelInput, Noise
from caesura_service.changepoint.compiled_filter import CompiledRunLengthFilter
from caesura_service.changepoint.constant_models import FreeSpaceForce
from caesura_service.changepoint.filter_parameters import FilterParameters
from caesura_service.changepoint.hazard import Geometric
from caesura_service.changepoint.segment_model_set import SegmentKind, SegmentModelSet

Array = NDArray[np.float64]

MEAN_SAMPLES = 20.0
ROUNDS = 5
LEVEL = SegmentModelSet(
    {"level": FreeSpaceForce(Noise(2.0, 0.3), bias=5.0)},
    (SegmentKind("steady", "steady", "free", ("level",)),),
)
PRUNED = FilterParameters(certain=1.0)
UNPRUNED = replace(PRUNED, prune_ratio=0.0, keep_youngest=0, cap=1000)


def one_level(series: Sequence[Array]) -> Iterator[tuple[str, int, float]]:
    """(name, axes, seconds of processor time) of each over a series of (3,), taken in turn."""
    vertical = [float(value[2]) for value in series]
    methods: list[tuple[str, int, Any]] = [
        ("caesura, pruned", 3, partial(own, series, PRUNED)),
        ("caesura, unpruned", 3, partial(own, series, UNPRUNED)),
    ]
    if (others := bocpd()) is not None:
        methods.append(("changepoint (Rust) Bocpd", 1, partial(others, vertical)))
    if (others := bcd_online()) is not None:
        methods.append(("bayesian-changepoint-detection online", 1, partial(others, np.array(vertical))))
    taken: list[list[float]] = [[] for _ in methods]
    for _ in range(ROUNDS):
        for mine, (_, _, run) in zip(taken, methods, strict=True):
            before = time.thread_time()
            run()
            mine.append(time.thread_time() - before)
    for (name, axes, _), seconds in zip(methods, taken, strict=True):
        yield name, axes, statistics.median(seconds)


def own(series: Sequence[Array], parameters: FilterParameters) -> None:
    """Our filter over a series."""
    online = CompiledRunLengthFilter(LEVEL, Geometric(MEAN_SAMPLES), parameters)
    zero = np.zeros(3)
    for force in series:
        online.step(ModelInput(zero, force))


def bocpd() -> Any:
    """`changepoint.Bocpd` over a series of numbers; None where it is not installed."""
    try:
        import changepoint  # noqa: PLC0415
    except ImportError:
        return None

    def run(series: Sequence[float]) -> None:
        detector = changepoint.Bocpd(prior=changepoint.NormalGamma(), lam=MEAN_SAMPLES)
        for value in series:
            detector.step(value)

    return run


def bcd_online() -> Any:
    """bayesian-changepoint-detection's online function, which takes the whole series at once."""
    try:
        from bayesian_changepoint_detection import online_changepoint_detection as online  # noqa: PLC0415
    except ImportError:
        return None

    def run(series: Array) -> None:
        hazard = partial(online.constant_hazard, MEAN_SAMPLES)
        online.online_changepoint_detection(series, hazard, online.StudentT(0.1, 0.01, 1, 0))

    return run


def bcd_offline() -> Any:
    """Its offline recursion over a series of numbers; it wants functions from where SciPy once had them."""
    once = types.ModuleType("scipy.misc")
    once.comb, once.logsumexp = scipy.special.comb, scipy.special.logsumexp  # type: ignore[attr-defined]
    sys.modules["scipy.misc"] = once
    try:
        from bayesian_changepoint_detection import offline_changepoint_detection as offline  # noqa: PLC0415
    except ImportError:
        return None

    def run(series: Array) -> None:
        prior = partial(offline.const_prior, l=len(series) + 1)
        offline.offline_changepoint_detection(
            series, prior, offline.gaussian_obs_log_likelihood, truncate=-40
        )

    return run
