"""A short part of the fuzzer; `make faults` sends 105,000 inputs."""

from __future__ import annotations

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from caesura_service.segmentation.pipeline import make_pipeline
from harness.hostile import Hostile, Target, read_everything

ATTACKS = 25
QUICKLY = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
RANDOM = st.randoms(use_true_random=True)


@settings(QUICKLY, max_examples=100)
@given(RANDOM)
def test_nothing_but_a_protocol_error_leaves_the_codec(rng):
    for _ in range(ATTACKS):
        read_everything(Hostile(rng).payload())


@settings(QUICKLY, max_examples=100)
@given(RANDOM)
def test_nothing_raises_out_of_the_registry_and_no_other_station_notices(rng):
    target = Target()
    for _ in range(ATTACKS):
        target.attack(Hostile(rng))


@settings(QUICKLY, max_examples=8)
@given(RANDOM)
def test_the_real_models_survive_too(rng):
    target = Target(make_pipeline, "default")
    for _ in range(ATTACKS):
        target.attack(Hostile(rng))
