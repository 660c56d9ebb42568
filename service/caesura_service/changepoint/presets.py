"""All presets by name."""

from __future__ import annotations

from collections.abc import Mapping

from caesura_service.changepoint.default import DEFAULT, STROKES, WITHOUT
from caesura_service.changepoint.preset import Preset
from caesura_service.changepoint.thesis_presets import THESIS_PRESETS

__all__ = ["PRESETS", "WITHOUT", "Preset", "preset_named"]

PRESETS: Mapping[str, Preset] = {preset.name: preset for preset in (*THESIS_PRESETS, STROKES, DEFAULT)}


def preset_named(name: str) -> Preset:
    """A preset, or `default` without one of its principles. Raises KeyError naming the presets."""
    known = {**PRESETS, **WITHOUT}
    if name not in known:
        raise KeyError(f"no preset {name!r}; known: {sorted(PRESETS)}")
    return known[name]
