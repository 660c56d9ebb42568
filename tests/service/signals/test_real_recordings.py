"""Real hand-guided recordings come out as plausible observations. Skipped where they are not at hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from caesura_service.signals import Conditioner, ConditioningOutput, SampleLayout
from service.signals.samples import FORCE, JOINTS, POSITION, QUATERNION, bits, column, together

Array = NDArray[np.float64]

FOLDER = Path(__file__).parents[4] / "shared" / "data" / "real"
DRAGGED = ("modena_panda_0", "modena_panda_1", "modena_panda_2")
WIPING = ("icsc_wiping_rim_1", "icsc_wiping_rim_2")


def recording(name: str) -> dict[str, Array]:
    path = FOLDER / f"{name}.npz"
    if not path.is_file():
        pytest.skip(f"{path} is not there: real recordings are not part of the repository")
    with np.load(path, allow_pickle=False) as file:
        return {key: file[key] for key in file.files}


def dragged(name: str) -> tuple[dict[str, Array], Conditioner, Array]:
    data = recording(name)
    conditioner = Conditioner(SampleLayout(("t", *POSITION, *FORCE), "flange_sensor_with_hand"))
    return data, conditioner, np.column_stack([data["t"], data["pos"], data["force"]])


def wiping(name: str) -> tuple[dict[str, Array], Conditioner, Array]:
    data = recording(name)
    layout = SampleLayout(("t", *POSITION, *QUATERNION, *JOINTS, *FORCE), "flange_sensor")
    columns = (data["t"], data["pos"], data["quat"], data["q"], data["force_base"])
    return data, Conditioner(layout), np.column_stack(columns)


def check_against_the_recording(data: dict[str, Array], result: ConditioningOutput) -> None:
    t = column(result.observations, "t")
    assert_allclose(np.diff(t), 0.1, atol=1e-9)
    assert len(t) == int((data["t"][-1] - 0.055) * 10)
    recorded = np.stack([np.interp(t, data["t"], axis) for axis in data["pos"].T], axis=1)
    assert_allclose(column(result.observations, "position_base"), recorded, atol=5e-4)
    ahead, behind = (np.stack([np.interp(t + s, data["t"], x) for x in data["pos"].T]) for s in (0.02, -0.02))
    speed = np.linalg.norm(ahead - behind, axis=0) / 0.04
    assert_allclose(column(result.observations, "speed"), speed, atol=0.02)
    assert result.gaps == ()
    assert result.repeats == 0


@pytest.mark.parametrize("name", DRAGGED)
def test_a_dragged_panda_follows_its_recording(name: str) -> None:
    data, conditioner, samples = dragged(name)
    result = together(conditioner, np.array_split(samples, len(samples) // 20))
    check_against_the_recording(data, result)
    assert conditioner.tare is not None
    assert_allclose(column(result.observations[:4], "force_base"), 0.0, atol=0.5)
    assert 1.0 < np.abs(column(result.observations, "force_base")).max() < 60.0


@pytest.mark.parametrize("name", WIPING)
def test_a_wiping_robot_follows_its_recording(name: str) -> None:
    data, conditioner, samples = wiping(name)
    result = together(conditioner, np.array_split(samples, 100))
    check_against_the_recording(data, result)
    t = column(result.observations, "t")
    phase = data["label"][np.searchsorted(data["t"], t)]
    pressing = np.linalg.norm(column(result.observations, "force_base"), axis=1)
    assert np.median(pressing[phase == 2]) > 2 * np.median(pressing[phase == 1])
    assert_allclose(np.linalg.norm(column(result.observations, "orientation"), axis=1), 1.0, atol=1e-14)


def test_a_lost_stretch_of_a_real_recording_is_reported() -> None:
    data, conditioner, samples = dragged("modena_panda_0")
    lost = (data["t"] > 3.0) & (data["t"] < 4.0)
    result = together(conditioner, [samples[~lost]])
    ((before, after),) = result.gaps
    assert (before, after) == (pytest.approx(3.0, abs=0.01), pytest.approx(4.0, abs=0.01))
    assert [o.after_gap for o in result.observations].count(True) == 1


@pytest.mark.parametrize("name", DRAGGED[:1])
def test_real_jitter_cut_sample_by_sample_gives_the_same_bits(name: str) -> None:
    _, conditioner, samples = dragged(name)
    whole = bits(together(conditioner, [samples]))
    conditioner.reset()
    assert bits(together(conditioner, np.split(samples, len(samples)))) == whole
