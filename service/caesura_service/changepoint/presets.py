"""All presets by name."""

from __future__ import annotations

from collections.abc import Mapping

from caesura_service.changepoint.default_presets import DEFAULT, STROKES, WITHOUT
from caesura_service.changepoint.preset import Preset
from caesura_service.changepoint.thesis_presets import THESIS_PRESETS

__all__ = ["KNOWN_PRESETS", "PRESETS", "WITHOUT", "Preset", "preset_named"]

PRESETS: Mapping[str, Preset] = {preset.name: preset for preset in (*THESIS_PRESETS, STROKES, DEFAULT)}
#: By name in order: presets, and behind them `default` without one of its principles.
KNOWN_PRESETS: Mapping[str, Preset] = dict([*sorted(PRESETS.items()), *sorted(WITHOUT.items())])


def preset_named(name: str) -> Preset:
    """Return a preset, or `default` without one of its principles.

    Raises KeyError, which lists the presets.
    """
    if name not in KNOWN_PRESETS:
        raise KeyError(f"no preset {name!r}; known: {', '.join(KNOWN_PRESETS)}")
    return KNOWN_PRESETS[name]
