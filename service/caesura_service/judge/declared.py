"""What a session declares of a recording: what the recording states, else what its annotation states.

The only place that knows how a `Recording` leaves its wrench source unstated.
"""

from __future__ import annotations

from dataclasses import MISSING, fields, replace
from typing import Any

from caesura_clients.recording import Recording
from caesura_service import signals
from caesura_service.recordings import opening_of
from caesura_service.session.pipeline import layout_of
from caesura_service.truth import Truth

WITH_HAND = "flange_sensor_with_hand"
DEFAULTS = {field.name: field.default for field in fields(Recording) if field.default is not MISSING}


def with_declarations(recording: Recording, truth: Truth) -> Recording:
    """Add what the annotation declares of wrench and hand where the recording states nothing.

    An annotation with the hand in the wrench turns `flange_sensor`, stated or not, into
    `flange_sensor_with_hand`.
    """
    declared: dict[str, Any] = {}
    if truth.wrench_source is not None and _is_unstated(recording, "wrench_source"):
        declared["wrench_source"] = truth.wrench_source
    if truth.hand_on_robot is not None and _is_unstated(recording, "hand_on_robot"):
        declared["hand_on_robot"] = truth.hand_on_robot
    if truth.hand_in_wrench and declared.get("wrench_source", recording.wrench_source) in _FLANGE_SENSOR:
        declared["wrench_source"] = WITH_HAND
    return replace(recording, **declared)


def capabilities_of(recording: Recording) -> Any:
    """Return what a session does with the wrench of a recording: by its statement, else by assumption."""
    layout = layout_of(opening_of(recording))
    return getattr(layout, "source", None) or signals.WRENCH_SOURCES[layout.wrench_source]


_FLANGE_SENSOR = ("flange_sensor", None)


def _is_unstated(recording: Recording, name: str) -> bool:
    """Return whether a field is there and has its default: recordings do not say whether that was stated."""
    return name in DEFAULTS and getattr(recording, name) == DEFAULTS[name]
