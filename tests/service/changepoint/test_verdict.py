"""A segment's class: the best kind of its group, and the name of a movement that the rotation explains."""

from __future__ import annotations

import numpy as np
import pytest

from caesura_service.changepoint.evidence_window import PathSegment
from caesura_service.changepoint.rate_of_change_bounds import RateOfChangeBounds
from caesura_service.changepoint.segment_model_set import SegmentKind, SegmentModelSet
from caesura_service.changepoint.segments import Classification, verdict

KINDS = (
    SegmentKind("motion", "motion", "free", ("any",)),
    SegmentKind("steady", "steady", "free", ("any",)),
    SegmentKind("transport", "motion", "transport", ("any",)),
    SegmentKind("turning", "motion", "free", ("any",)),
    SegmentKind("turning", "motion", "transport", ("any",)),
)
LATTICE = SegmentModelSet({"any": RateOfChangeBounds("rotation")}, KINDS)


def shown(evidence: tuple[float, ...], *, is_turn: bool | None) -> Classification:
    """evidence: (kinds,) log evidence; is_turn: whether the rotation explains it, None without the rule."""
    asked = None if is_turn is None else lambda: bool(is_turn)
    return verdict(LATTICE, PathSegment(0, np.array(evidence)), asked)


def test_a_load_that_is_turned_keeps_its_contact() -> None:
    assert shown((0.0, -9.0, 3.0, 1.0, -9.0), is_turn=True).kind == KINDS[4]
    assert shown((0.0, -9.0, 3.0, 1.0, -9.0), is_turn=False).kind == KINDS[2]
    assert shown((0.0, -9.0, 3.0, 1.0, -9.0), is_turn=None).kind == KINDS[2]


def test_the_name_has_the_probability_of_movement_and_turning_together() -> None:
    evidence = (3.0, 1.0, -20.0, 2.0, -20.0)
    weights = np.exp(evidence)
    turned, moved = (shown(evidence, is_turn=explains) for explains in (True, False))
    assert turned.kind == KINDS[3]
    assert turned.probability == pytest.approx((weights[0] + weights[3] + weights[4]) / weights.sum())
    assert moved.probability == pytest.approx(weights[0] / weights.sum())
    assert turned.runner_up == KINDS[1]
    assert turned.log_odds == pytest.approx(2.0)
    assert moved.runner_up == KINDS[3]


@pytest.mark.parametrize("evidence", [(0.0, 3.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 3.0, 0.0)])
def test_a_rest_and_a_turning_of_the_filter_stay(evidence: tuple[float, ...]) -> None:
    assert shown(evidence, is_turn=True) == shown(evidence, is_turn=None)
