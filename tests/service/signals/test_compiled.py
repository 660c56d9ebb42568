"""Compiled arithmetic against the reference: samples of any kind, to 1e-12."""

from __future__ import annotations

from itertools import chain

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from caesura_service.signals import Conditioner, ConditioningOutput, Observation, SampleLayout, backend
from caesura_service.signals.backend import REFERENCE, best
from caesura_service.signals.kernel_warm_up import prepare
from service.signals.awkward import LAYOUTS, awkward_samples
from service.signals.samples import bits, together

Array = NDArray[np.float64]


def numbers(observation: Observation) -> Array:
    """All of them, one after the other."""
    values = (np.ravel(value) for value in vars(observation).values() if value is not None)
    return np.array(list(chain.from_iterable(values)), dtype=np.float64)


def assert_agree(compiled: ConditioningOutput, reference: ConditioningOutput) -> None:
    assert len(compiled.observations) == len(reference.observations)
    for own, others in zip(compiled.observations, reference.observations, strict=True):
        assert_allclose(numbers(own), numbers(others), rtol=1e-12, atol=1e-12)
    assert compiled[1:] == reference[1:]


@pytest.mark.slow
@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    rate_hz=st.sampled_from([50.0, 60.0, 100.0, 333.3, 1000.0]),
    pushes=st.integers(1, 30),
)
def test_both_give_the_same(layout: SampleLayout, seed: int, rate_hz: float, pushes: int) -> None:
    samples = np.array_split(awkward_samples(layout, seed, rate_hz, n=round(1.5 * rate_hz)), pushes)
    compiled, reference = (Conditioner(layout, arithmetic=each) for each in (best(), REFERENCE))
    assert_agree(together(compiled, samples), together(reference, samples))


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_whatever_an_array_is_like_all_is_compiled_beforehand(layout: SampleLayout) -> None:
    prepare()
    samples = awkward_samples(layout, 1, 200.0, n=400)
    constant = samples.copy()
    constant.flags.writeable = False
    alike = (samples, np.asfortranarray(samples), np.repeat(samples, 2, axis=1)[:, ::2], constant)
    results = [bits(together(Conditioner(layout), [array])) for array in alike]
    assert results == results[:1] * len(alike)
    assert [len(kernel.signatures) for kernel in best()] == [1] * len(best())


def test_without_a_compiler_the_reference_stands_in(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(backend, "has_kernels", lambda: False)
    assert backend.best.__wrapped__() == REFERENCE
