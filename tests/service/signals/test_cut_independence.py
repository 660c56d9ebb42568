"""However samples are cut into pushes, the same bits come out."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from caesura_service.signals import Conditioner, SampleLayout
from caesura_service.signals.backend import REFERENCE, Backend, best
from service.signals.awkward import LAYOUTS, awkward_samples
from service.signals.samples import bits, together

Array = NDArray[np.float64]


def cut(samples: Array, places: list[int]) -> list[Array]:
    bounds = [0, *sorted(place % (len(samples) + 1) for place in places), len(samples)]
    return [samples[a:b] for a, b in pairwise(bounds)]


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    rate_hz=st.sampled_from([60.0, 100.0, 200.0, 333.3, 1000.0]),
    places=st.lists(st.integers(0, 10_000), max_size=40),
)
def test_any_cuts_give_the_same_bits(
    layout: SampleLayout, seed: int, rate_hz: float, places: list[int]
) -> None:
    samples = awkward_samples(layout, seed, rate_hz, n=round(1.5 * rate_hz))
    whole = together(Conditioner(layout), [samples])
    assert bits(together(Conditioner(layout), cut(samples, places))) == bits(whole)


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
@pytest.mark.parametrize("arithmetic", [REFERENCE, best()], ids=["reference", "best"])
@pytest.mark.parametrize(("seed", "rate_hz"), [(1, 100.0), (2, 200.0), (3, 1000.0)])
def test_sample_by_sample_gives_the_same_bits(
    layout: SampleLayout, seed: int, rate_hz: float, arithmetic: Backend
) -> None:
    samples = awkward_samples(layout, seed, rate_hz, n=700)
    whole = together(Conditioner(layout, arithmetic=arithmetic), [samples])
    assert len(whole.observations) > 3
    one_by_one = together(Conditioner(layout, arithmetic=arithmetic), np.split(samples, len(samples)))
    assert bits(one_by_one) == bits(whole)


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_a_caller_may_use_its_array_again(layout: SampleLayout) -> None:
    samples = awkward_samples(layout, 4, 1000.0, n=1000)
    array = np.empty((20, samples.shape[1]))

    def in_the_same_array() -> Iterator[Array]:
        for batch in np.split(samples, 50):
            array[:] = batch
            yield array

    assert bits(together(Conditioner(layout), in_the_same_array())) == bits(
        together(Conditioner(layout), [samples])
    )


def test_a_reset_conditioner_gives_the_same_bits_again() -> None:
    layout = LAYOUTS["pose, flange force, gripper"]
    samples = awkward_samples(layout, 5, 200.0, n=600)
    conditioner = Conditioner(layout)
    first = together(conditioner, cut(samples, [100, 333]))
    conditioner.reset()
    assert bits(together(conditioner, [samples])) == bits(first)


def test_a_copy_goes_on_as_the_original_would_have() -> None:
    layout = LAYOUTS["joints and torques"]
    samples = awkward_samples(layout, 6, 500.0, n=900)
    original = Conditioner(layout)
    original.push(samples[:400])
    twin = copy.deepcopy(original)
    continued = bits(together(original, [samples[400:]]))
    assert bits(together(twin, [samples[400:]])) == continued


def test_a_declared_gap_falls_between_the_same_samples_however_they_are_cut() -> None:
    layout = LAYOUTS["pose, flange force, gripper"]
    samples = awkward_samples(layout, 7, 1000.0, n=2000)
    results = []
    for size in (1, 7, 1000):
        conditioner = Conditioner(layout)
        before = [conditioner.push(samples[i : min(i + size, 1000)]) for i in range(0, 1000, size)]
        conditioner.declare_gap()
        after = together(conditioner, [samples[i : i + size] for i in range(1000, 2000, size)])
        results.append(([o.t for r in before for o in r.observations], bits(after)[:3]))
    assert results[0] == results[1] == results[2]
