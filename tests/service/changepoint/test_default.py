"""Our preset, and itself without each of its principles."""

from __future__ import annotations

import pickle
from pathlib import Path

import pytest

from caesura_clients.recording import load_recording
from caesura_service.changepoint.default import DEFAULT, WITHOUT
from caesura_service.changepoint.presets import PRESETS, preset_named
from caesura_service.recordings import segment_recording

BUTTON = Path(__file__).parents[3] / "data" / "button.npz"

TOUCHED = {
    "without_guided_motion": {"moving"},
    "without_corners": {"corner"},
    "without_sensor_noise": {"moving", "still", "stopped", "pressed"},
    "without_speed_noise": {"moving"},
    "without_bias": {"untouched"},
    "without_change": {"pressed"},
    "without_correlation": {"moving", "untouched", "pressed", "laden"},
    "without_pace": {"moving", "still"},
    "without_friction": {"slid_along"},
    "without_torque": {"resisted", "unresisted"},
    "without_transitions": set(),
    "without_refractory": set(),
    "without_power": set(),
}


def test_every_principle_is_left_out_once() -> None:
    assert set(WITHOUT) == set(TOUCHED)


@pytest.mark.parametrize("name", WITHOUT)
def test_leaving_a_principle_out_changes_its_channels_and_nothing_else(name: str) -> None:
    full, less = ({c: pickle.dumps(m) for c, m in p.channels(1.5).items()} for p in (DEFAULT, WITHOUT[name]))
    assert set(full) == set(less)
    assert {channel for channel in full if full[channel] != less[channel]} == TOUCHED[name]
    assert WITHOUT[name].kinds == DEFAULT.kinds
    changed = {
        field
        for field in ("unrepeated", "refractory_s", "mean_segment_s", "power", "filter")
        if getattr(WITHOUT[name], field) != getattr(DEFAULT, field)
    }
    of_preset = {"transitions": "unrepeated", "refractory": "refractory_s", "power": "power"}
    expected = of_preset.get(name.removeprefix("without_"))
    assert changed == ({expected} if expected else set())


@pytest.mark.parametrize("name", WITHOUT)
def test_a_recording_can_be_segmented_without_it(name: str) -> None:
    kinds = [segment.kind for segment in segment_recording(load_recording(BUTTON), name).segments]
    assert "motion" in kinds


def test_a_preset_that_is_none_is_refused_with_those_there_are() -> None:
    with pytest.raises(KeyError, match=r"constant_velocity.*second_order_2"):
        preset_named("without")
    assert not set(WITHOUT) & set(PRESETS)
