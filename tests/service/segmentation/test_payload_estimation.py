"""A load is weighed against free space, and only against what is free space."""

from __future__ import annotations

import numpy as np
import pytest

from caesura_service.changepoint.segment_model_set import SegmentKind
from caesura_service.changepoint.segments import Classification, InferredSegment
from caesura_service.segmentation.observation_store import ObservationStore
from caesura_service.segmentation.payload_estimation import Load, weigh
from service.sessions.observing import observation

LENGTH = 20
WEIGHT_N = 0.5 * 9.81


def story(*parts: tuple[str, float]) -> tuple[list[InferredSegment], ObservationStore]:
    """Stretches of LENGTH observations: contact state and vertical force [N]."""
    history, stretches = ObservationStore(), []
    for number, (contact, force) in enumerate(parts):
        kind = SegmentKind("any", "motion", contact, ())  # type: ignore[arg-type]
        start = number * LENGTH
        stretches.append(
            InferredSegment(
                start, start + LENGTH, Classification(kind, 1.0, None, 0.0), 1.0, (start, start), True, True
            )
        )
        for i in range(LENGTH):
            history.append(observation(start + i, force))
    return stretches, history


def loads(*parts: tuple[str, float], bias_n: float = 1.5) -> list[Load | None]:
    stretches, history = story(*parts)
    return [weigh(stretches, index, history, bias_n) for index in range(len(stretches))]


def test_the_bias_on_both_sides_is_taken_off():
    before, load, after = loads(("free", 0.8), ("transport", 1.0 - WEIGHT_N), ("free", 1.2))
    assert before is after is None
    assert load is not None
    assert load.kg == pytest.approx(0.5, abs=1e-9)
    assert load.sd_kg == pytest.approx(0.4 / np.sqrt(12.0) / 9.81, abs=1e-9)


def test_a_press_that_passes_for_free_space_is_no_baseline():
    load = loads(("free", 0.0), ("free", 8.0), ("transport", -WEIGHT_N), ("free", 7.0))[2]
    assert load is not None
    assert load.kg == pytest.approx(0.5, abs=1e-9)


def test_without_free_space_the_bias_is_all_that_is_known():
    (load,) = loads(("transport", -WEIGHT_N), bias_n=5.0)
    assert load is not None
    assert load.sd_kg == pytest.approx(5.0 / 9.81)


def test_nothing_weighs_less_than_nothing():
    load = loads(("free", 0.0), ("transport", 1.0))[1]
    assert load is not None
    assert load.kg == 0.0
