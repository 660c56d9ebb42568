"""Our preset, and itself without each of its principles."""

from __future__ import annotations

import pickle
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from caesura_protocol.formats.read import load_recording
from caesura_protocol.recording import Recording
from caesura_service.changepoint.channel_model import ModelInput
from caesura_service.changepoint.default_presets import DEFAULT, WITHOUT, default_channels
from caesura_service.changepoint.presets import PRESETS, preset_named
from caesura_service.changepoint.profile_library import minimum_jerk
from caesura_service.changepoint.segments import stretches
from caesura_service.constants import TARED_BIAS_N
from harness.segmentations import segmented

BUTTON = Path(__file__).parents[3] / "data" / "button.npz"

TOUCHED = {
    "without_guided_motion": {"moving"},
    "without_corners": {"corner"},
    "without_sensor_noise": {"moving", "still", "stopped", "pressed"},
    "without_speed_noise": {"moving"},
    "without_heavy_tails": {"moving"},
    "without_bias": {"untouched"},
    "without_continued_levels": {"untouched", "laden"},
    "without_change": {"pressed"},
    "without_corner_chords": {"corner", "turned_back"},
    "without_straight_ways": {"corner", "turned_back"},
    "without_correlation": {"moving", "untouched", "pressed", "laden"},
    "without_pace": {"moving", "still"},
    "without_dissipation": {"resisting"},
    "without_torque": {"resisted", "unresisted"},
    "without_load_by_weight": {"untouched", "not_set_in"},
    "without_traced_motion": {"traced"},
    "without_transitions": set(),
    "without_refractory": set(),
    "without_power": set(),
    "without_explained_turns": set(),
}


KINDS_TOUCHED = {
    "without_load_by_weight": {"transport", "hold", "turning"},
    "without_traced_motion": {"motion", "sliding", "transport"},
    "without_transitions": {"motion", "sliding", "transport"},
}


def test_every_principle_is_left_out_once() -> None:
    assert set(WITHOUT) == set(TOUCHED)


@pytest.mark.parametrize("name", WITHOUT)
def test_leaving_a_principle_out_changes_its_channels_and_nothing_else(name: str) -> None:
    full, less = ({c: pickle.dumps(m) for c, m in p.channels(1.5).items()} for p in (DEFAULT, WITHOUT[name]))
    assert {channel for channel in full if full[channel] != less.get(channel)} == TOUCHED[name]
    assert set(less) <= set(full)
    kinds = {kind.name for kind in {*WITHOUT[name].kinds} ^ {*DEFAULT.kinds}}
    assert kinds == KINDS_TOUCHED.get(name, set())
    changed = {
        field
        for field in ("unrepeated", "refractory_s", "mean_segment_s", "power", "turn_share", "filter")
        if getattr(WITHOUT[name], field) != getattr(DEFAULT, field)
    }
    of_preset = {
        "transitions": "unrepeated",
        "refractory": "refractory_s",
        "power": "power",
        "explained_turns": "turn_share",
    }
    expected = of_preset.get(name.removeprefix("without_"))
    assert changed == ({expected} if expected else set())


@cache
def taught_in_part() -> Recording:
    """The first half of the recording, at 200 Hz."""
    whole = load_recording(BUTTON)
    part = slice(0, len(whole.t) // 2, 5)
    return replace(whole, t=whole.t[part], signals={name: one[part] for name, one in whole.signals.items()})


@pytest.mark.parametrize("name", WITHOUT)
def test_a_recording_can_be_segmented_without_it(name: str) -> None:
    kinds = [segment.kind for segment in segmented(taught_in_part(), name).segments]
    assert {"motion", "contact"} <= set(kinds)


@pytest.mark.parametrize(
    ("force_n", "gripper", "expected"),
    [
        ((0.0, 0.0, -3.0), np.nan, "motion"),  # a bias that wanders while the arm moves
        ((4.0, 1.0, -6.0), np.nan, "motion"),  # what an estimate errs by, as soon as the arm moves
        ((0.0, 0.0, -6.0), 1.0, "transport"),
        ((0.0, 0.0, -15.0), np.nan, "transport"),
    ],
)
def test_a_load_is_distinguished_from_free_space_by_its_weight_and_the_gripper(
    force_n: tuple[float, float, float], gripper: float, expected: str
) -> None:
    """After one second at rest without a force the arm moves for two seconds with this one."""
    online = DEFAULT.online(bias_n=TARED_BIAS_N)
    bell = minimum_jerk(2.0)(np.arange(21, dtype=np.float64) * 0.1)
    for i in range(31):
        share = min(max((i - 10) / 4, 0.0), 1.0)  # sets in within 0.4 s
        position = np.array([0.2 * bell[max(i - 10, 0)], 0.0, 0.0])
        online.step(
            ModelInput(position, share * np.asarray(force_n, np.float64), gripper if i > 10 else np.nan)
        )
    longest = max(stretches(online), key=lambda one: one.end - one.start)
    assert longest.verdict.kind.name == expected


def test_a_preset_that_is_none_is_refused_with_those_there_are() -> None:
    with pytest.raises(KeyError, match=r"constant_velocity.*second_order_2"):
        preset_named("without")
    assert not set(WITHOUT) & set(PRESETS)


def test_a_gripper_that_holds_something_has_a_load_99_times_of_100_whatever_the_prior_of_loads():
    weights = {kind.name: kind.weight for kind in DEFAULT.kinds if "moving" in kind.channels}
    channels = default_channels(1.0)
    odds = weights["transport"] * channels["holding"].probability
    odds /= weights["motion"] * channels["empty"].probability
    assert odds == pytest.approx(0.99 / 0.01)
