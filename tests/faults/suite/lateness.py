"""How late results are: from when a robot gave the last sample of an observation until its result is read.

A result that is compared with another one of the same run would hide what delays all of them.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from caesura_service.offline_segmentation import opening_of
from caesura_service.segmentation.pipeline import make_pipeline
from faults.suite.outcome import Played
from faults.suite.stations import TaughtStation, demonstration

SLACK_S = 1e-9  # of a time that was added up


def lateness_ms(done: Played) -> list[float]:
    """[ms] of every result of a station, but of those that its close brings."""
    late: list[float] = []
    for one in done.found:
        given_s, known_t = given(one.station), known(one.station)
        for at, t in done.watched.came[one.station.name]:
            batch = int(np.searchsorted(known_t, t - SLACK_S))
            if batch < len(known_t):
                late.append(1e3 * (at - given_s[batch]))
    return late


def given(station: TaughtStation) -> NDArray[np.float64]:
    """(batches,) [s] monotonic, when the robot gave the last sample of each batch."""
    assert station.robot is not None
    at, until = np.array(station.robot.given).T
    last = station.recording.t[_ends(len(station.recording.t), _batch_samples(station)) - 1]
    places = np.searchsorted(until, last - SLACK_S)
    found: NDArray[np.float64] = at[places]
    return found


def known(station: TaughtStation) -> NDArray[np.float64]:
    """(batches,) [s] the newest observation after each batch."""
    return _known(station.number, station.seconds, _batch_samples(station))


@cache
def _known(number: int, seconds: float, batch_samples: int) -> NDArray[np.float64]:
    recording = demonstration(number, seconds)
    pipeline = make_pipeline(opening_of(recording), "default")
    rows, reached = recording.matrix(), []
    for batch in np.split(rows, _ends(len(rows), batch_samples)[:-1]):
        pipeline.push(batch)
        t = pipeline.view.t
        reached.append(-math.inf if t is None else t)
    return np.array(reached)


def _ends(samples: int, batch_samples: int) -> NDArray[np.int64]:
    """Of each batch, the number of samples up to its end."""
    whole = np.arange(batch_samples, samples + 1, batch_samples)
    return whole if samples % batch_samples == 0 else np.append(whole, samples)


def _batch_samples(station: TaughtStation) -> int:
    assert station.bridge is not None
    return station.bridge.settings.batch_samples
