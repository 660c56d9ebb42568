"""A segment's class: the best kind of its group, and the name of a movement that the rotation explains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from caesura_service.changepoint.channel_model_checks import NOWHERE, rows_after
from caesura_service.changepoint.constant_models import GripperHoldingChain, HoldingStates
from caesura_service.changepoint.default_presets import DEFAULT
from caesura_service.changepoint.evidence_window import PathSegment
from caesura_service.changepoint.segment_model_set import SegmentKind, SegmentModelSet
from caesura_service.changepoint.segments import Classification, verdict
from caesura_service.changepoint.step_size_weight import StepSizeWeight
from caesura_service.segmentation.observation_store import ObservationStore
from service.sessions.observing import observation

KINDS = (
    SegmentKind("motion", "motion", "free", ("any",)),
    SegmentKind("steady", "steady", "free", ("any",)),
    SegmentKind("transport", "motion", "transport", ("any",)),
    SegmentKind("turning", "motion", "free", ("any",)),
    SegmentKind("turning", "motion", "transport", ("any",)),
)
LATTICE = SegmentModelSet({"any": StepSizeWeight("rotation")}, KINDS)


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


@pytest.mark.parametrize("power", [1.0, 0.5])
def test_a_gripper_is_believed_by_how_often_it_errs_whatever_the_power(power: float) -> None:
    """The other signals of the segment fit a movement and a load alike."""
    lattice = replace(DEFAULT, power=power).lattice()
    moves, carries = (place_of(lattice, contact) for contact in ("free", "transport"))
    evidence = np.full(len(lattice.kinds), -1000.0)
    for place, chain in ((moves, "empty"), (carries, "holding")):
        rows = rows_after(lattice.channels[chain], [NOWHERE._replace(holding=1.0)] * 10)
        evidence[place] = lattice.log_weight[place] + lattice.channels[chain].log_evidence(rows)[0]
    ended = PathSegment(0, evidence)
    assert verdict(lattice, ended, states=HoldingStates(1.0, 9, 0)).probability == pytest.approx(0.99)
    assert (verdict(lattice, ended).probability == pytest.approx(0.99)) == (power == 1.0)


def place_of(lattice: SegmentModelSet, contact: str) -> int:
    kinds = enumerate(lattice.kinds)
    return next(i for i, one in kinds if one.motion == "motion" and one.contact == contact)


@pytest.mark.parametrize("seen", [(1.0,), (0.0, 0.0, 1.0), (np.nan, 1.0, np.nan, 0.0, 1.0, 1.0)])
def test_the_likelihood_of_the_known_states_is_the_evidence_of_their_chain(seen: tuple[float, ...]) -> None:
    chain, history = GripperHoldingChain(0.2, change=0.1), ObservationStore()
    for index, state in enumerate((1.0, *seen)):
        closed = None if np.isnan(state) else bool(state)
        history.append(replace(observation(index, 0.0), gripper_closed=closed))
    states = history.holding_states(1, 1 + len(seen))
    assert states is not None
    inputs = [NOWHERE._replace(holding=state) for state in seen]
    expected = chain.log_evidence(rows_after(chain, inputs))[0]
    assert chain.log_likelihood(states) == pytest.approx(expected)


def test_a_chain_may_exclude_a_state_and_a_change() -> None:
    """A chain without changes raised a ValueError at the logarithm of 0 wherever a state was known."""
    never = GripperHoldingChain(1.0, change=0.0)
    assert never.log_likelihood(HoldingStates(1.0, 3, 0)) == 0.0
    assert never.log_likelihood(HoldingStates(0.0, 3, 0)) < -700.0
    assert never.log_likelihood(HoldingStates(1.0, 3, 1)) < -700.0


@pytest.mark.parametrize("evidence", [(0.0, 3.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 3.0, 0.0)])
def test_a_rest_and_a_turning_of_the_filter_stay(evidence: tuple[float, ...]) -> None:
    assert shown(evidence, is_turn=True) == shown(evidence, is_turn=None)
