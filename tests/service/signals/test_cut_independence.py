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

from caesura_service.signals import Conditioner, Layout
from service.signals.samples import FORCE, JOINTS, POSITION, QUATERNION, TAU, bits, together

Array = NDArray[np.float64]


def pose_of_joints(q: Array) -> tuple[Array, Array]:
    angle = q[:, 0] / 2
    zero = np.zeros(len(q))
    return np.sin(q[:, :3]), np.stack([zero, zero, np.sin(angle), np.cos(angle)], axis=1)


def wrench_of_joint_torques(q: Array, tau: Array) -> Array:
    return tau[:, :6] * np.cos(q[:, :1])


LAYOUTS = {
    "pose, flange force, gripper": Layout(
        ("t", *POSITION, *QUATERNION, *FORCE, "gripper"), force_frame="flange"
    ),
    "joints and torques": Layout(
        ("t", *JOINTS, *TAU),
        wrench_source="joint_torque_estimate",
        pose_of_joints=pose_of_joints,
        wrench_of_joint_torques=wrench_of_joint_torques,
    ),
    "position, joints, force in base": Layout(
        ("t", "gripper", *FORCE, *POSITION, *JOINTS), metres_per_unit=0.001
    ),
}


def awkward_samples(layout: Layout, seed: int, rate_hz: float, n: int) -> Array:
    """Jitter, repeats, samples on cell edges, gaps, a flag or an opening, a start at rest or in motion."""
    rng = np.random.default_rng(seed)
    t = rng.uniform(-5, 5) + np.arange(n) / rate_hz
    if rng.random() < 0.7:
        t[1:] += rng.uniform(-0.6, 0.6, n - 1) / rate_hz
    t[rng.random(n) < 0.03] -= 2 / rate_hz
    for gap in rng.integers(1, n, size=rng.integers(0, 3)):
        t[gap:] += rng.uniform(0.1, 0.6)
    samples = {name: np.cumsum(rng.normal(0, 1e-3, n)) for name in layout.columns}
    samples |= {name: rng.normal(0, rng.choice([0.1, 2.0]), n) for name in (*FORCE, *TAU)}
    turns = rng.normal(size=4) + np.cumsum(rng.normal(0, 0.02, (n, 4)), axis=0)
    turns *= rng.choice([-1, 1], (n, 1)) / np.linalg.norm(turns, axis=1)[:, None]
    samples |= dict(zip(QUATERNION, turns.T, strict=True))
    squeezed = np.repeat(rng.choice([0.0, 0.0, 1.0], 8), -(-n // 8))[:n]
    samples["gripper"] = squeezed if rng.random() < 0.5 else 0.08 - 0.05 * squeezed
    return np.column_stack([t, *(samples[name] for name in layout.columns[1:])])


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
def test_any_cuts_give_the_same_bits(layout: Layout, seed: int, rate_hz: float, places: list[int]) -> None:
    samples = awkward_samples(layout, seed, rate_hz, n=round(1.5 * rate_hz))
    whole = together(Conditioner(layout), [samples])
    assert bits(together(Conditioner(layout), cut(samples, places))) == bits(whole)


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
@pytest.mark.parametrize(("seed", "rate_hz"), [(1, 100.0), (2, 200.0), (3, 1000.0)])
def test_sample_by_sample_gives_the_same_bits(layout: Layout, seed: int, rate_hz: float) -> None:
    samples = awkward_samples(layout, seed, rate_hz, n=700)
    whole = together(Conditioner(layout), [samples])
    assert len(whole.observations) > 3
    assert bits(together(Conditioner(layout), np.split(samples, len(samples)))) == bits(whole)


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_a_caller_may_use_its_array_again(layout: Layout) -> None:
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
