"""A load is weighed against free space, and only against what is free space."""

from __future__ import annotations

from dataclasses import replace

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


@pytest.mark.parametrize("sides", [(0.0, -2.4), (-2.4, 0.0)])
def test_a_light_load_that_is_shown_as_free_space_is_no_baseline(sides: tuple[float, float]) -> None:
    """A cup of 0.5 kg, poured out until 0.25 kg were left, was weighed against the mean of both: 0.38 kg."""
    before, after = sides
    load = loads(("free", before), ("transport", -WEIGHT_N), ("free", after), bias_n=2.3)[1]
    assert load is not None
    assert load.kg == pytest.approx(0.5, abs=1e-9)


def test_a_bias_that_wandered_aside_is_taken_off_on_both_sides() -> None:
    stretches, history = story(("free", 0.0), ("transport", -WEIGHT_N), ("free", -2.0))
    wandered = ObservationStore()
    for index in range(len(history)):
        seen = observation(index, history.force(index)[2])
        there = np.array([2.0 * (index >= 2 * LENGTH), 0.0, 0.0])
        wandered.append(replace(seen, force_base=seen.force_base + there))
    load = weigh(stretches, 1, wandered, 2.3)
    assert load is not None
    assert load.kg == pytest.approx((WEIGHT_N - 1.0) / 9.81, abs=1e-9)


def test_where_the_gripper_is_known_free_space_holds_nothing() -> None:
    stretches, history = story(("free", 0.0), ("transport", -WEIGHT_N), ("free", -2.0))
    gripped = ObservationStore()
    for index in range(len(history)):
        seen = observation(index, history.force(index)[2])
        gripped.append(replace(seen, gripper_closed=LENGTH <= index < 2 * LENGTH))
    load = weigh(stretches, 1, gripped, 2.3)
    assert load is not None
    assert load.kg == pytest.approx((WEIGHT_N - 1.0) / 9.81, abs=1e-9)
