"""Samples to condition, made from functions of time, and what comes out of a conditioner put side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from caesura_service.signals import (
    Conditioner,
    ConditioningOutput,
    ConditioningParameters,
    Observation,
    SampleLayout,
)

Array = NDArray[np.float64]

POSITION = ("px", "py", "pz")
QUATERNION = ("qx", "qy", "qz", "qw")
JOINTS = tuple(f"q{i}" for i in range(1, 8))
FORCE = ("fx", "fy", "fz")
TORQUE = ("mx", "my", "mz")
TAU = tuple(f"tau{i}" for i in range(1, 8))


def times(rate_hz: float, duration_s: float, *, start_s: float = 0.0) -> Array:
    return start_s + np.arange(round(rate_hz * duration_s) + 1) / rate_hz


def along(direction: tuple[float, float, float], values: Array) -> Array:
    return np.asarray(values)[:, None] * np.array(direction)


def condition(
    layout: SampleLayout, t: Array, *signals: Array, parameters: ConditioningParameters | None = None
) -> list[Observation]:
    """All observations of one demonstration, pushed at once."""
    conditioner = Conditioner(layout, parameters)
    return list(together(conditioner, [np.column_stack([t, *signals])]).observations)


def positions_only(t: Array, path: Callable[[Array], Array]) -> list[Observation]:
    """Observations of a flange that moves along x without a wrench."""
    layout = SampleLayout(("t", *POSITION), wrench_source="none")
    return condition(layout, t, along((1.0, 0.0, 0.0), path(t)))


def together(conditioner: Conditioner, pushes: Iterable[Array]) -> ConditioningOutput:
    """Push by push to the end, results joined."""
    results = [conditioner.push(samples) for samples in pushes]
    results.append(conditioner.finish())
    return ConditioningOutput(
        observations=tuple(o for r in results for o in r.observations),
        gaps=tuple(g for r in results for g in r.gaps),
        gripper_events=tuple(e for r in results for e in r.gripper_events),
        samples=sum(r.samples for r in results),
        repeats=sum(r.repeats for r in results),
    )


def bits(result: ConditioningOutput) -> tuple[object, ...]:
    """Everything in a result, exactly: equal if and only if every bit is."""
    observations = tuple(
        tuple(value.tobytes() if isinstance(value, np.ndarray) else value for value in vars(o).values())
        for o in result.observations
    )
    return observations, result.gaps, result.gripper_events, result.samples, result.repeats


def column(observations: list[Observation] | tuple[Observation, ...], name: str) -> Array:
    return np.array([getattr(o, name) for o in observations])
