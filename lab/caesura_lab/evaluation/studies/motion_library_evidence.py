"""The log evidence of recordings under several motion libraries, with nothing else of the model changed.

The evidence of a recording is that of all segmentations of it together, parameters integrated out, by the
exact offline recursion without pruning. The preset is `strokes`, because movements of `default` follow no
library. No truth is used. A library with more profiles has no advantage: each profile is less likely. A gap
divides a recording; its parts' evidences add up.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeGuard

from caesura_lab.evaluation.cases.suites import Case, FileCase
from caesura_lab.evaluation.reports.grids import Grid, GridPage
from caesura_lab.ground_truth import truth_file
from caesura_protocol.formats.read import load_recording
from caesura_protocol.number_words import counted
from caesura_protocol.recording import Recording, RecordingError
from caesura_service.changepoint.channel_model import ChannelModel
from caesura_service.changepoint.default_presets import STROKES, early_moves, even_moves
from caesura_service.changepoint.offline_posterior import segment_offline
from caesura_service.changepoint.preset import Preset
from caesura_service.changepoint.profile_library import Profile
from caesura_service.changepoint.profile_model import ProfileModel
from caesura_service.changepoint.thesis_presets import thesis_motion_library
from caesura_service.conditioned_recording import condition

NOTE = (
    "In nats behind the best; 'per observation' (0.1 s) of all recordings. The library of the model's "
    "movements is exchanged, its noise, prior and everything else are not."
)


def _overdamped() -> list[Profile]:
    return [*thesis_motion_library().profiles]


LIBRARIES: Mapping[str, Callable[[], list[Profile]]] = {
    "overdamped": _overdamped,
    "minimum jerk": even_moves,
    "lognormal": early_moves,
    "last two": lambda: [*even_moves(), *early_moves()],
    "all three": lambda: [*_overdamped(), *even_moves(), *early_moves()],
}


@dataclass(frozen=True)
class LibraryEvidence:
    """Log evidence of a recording under each library."""

    recording: str
    observations: int
    log_evidence: Mapping[str, float]


def with_profiles(preset: Preset, profiles: Sequence[Profile]) -> Preset:
    """Return the preset with other profiles of movement, and every other channel unchanged.

    Raises ValueError for a preset whose movements follow no library.
    """
    if not any(_has_library(model) for model in preset.lattice().channels.values()):
        raise ValueError(
            f"preset {preset.name!r} has no library of movements to exchange, expected {STROKES.name!r}"
        )

    def channels(bias_n: float) -> dict[str, ChannelModel]:
        return {name: _with_library(model, profiles) for name, model in preset.channels(bias_n).items()}

    return replace(preset, channels=channels)


def _has_library(model: ChannelModel) -> TypeGuard[ProfileModel]:
    return isinstance(model, ProfileModel) and model.channel == "position"


def _with_library(model: ChannelModel, profiles: Sequence[Profile]) -> ChannelModel:
    if _has_library(model):
        return replace(model, library=replace(model.library, profiles=profiles))
    return model


def library_evidence(case: Case) -> LibraryEvidence:
    """Return the evidence of one recording. Raises TruthError or RecordingError if it cannot be segmented."""
    recording = _load_recording(case)
    try:
        conditioned = condition(recording)
    except ValueError as error:
        raise RecordingError(f"{case.name}: {error}") from error
    if not conditioned.observations:
        raise RecordingError(f"{case.name}: no observations, expected at least one")
    evidences = {}
    for name, profiles in LIBRARIES.items():
        preset = with_profiles(STROKES, profiles())
        model = conditioned.make_filter(preset, orientation=False)
        evidences[name] = sum(
            segment_offline(model.lattice, model.hazard, stretch).log_evidence
            for stretch in conditioned.stretches
        )
    return LibraryEvidence(case.name, len(conditioned.observations), evidences)


def _load_recording(case: Case) -> Recording:
    """Load the recording of a case; a file need not be annotated here."""
    if isinstance(case, FileCase) and not truth_file(case.path).is_file():
        return load_recording(case.path, **case.reading._asdict())
    return case.load()[0]


def title(what: str, evidences: Sequence[LibraryEvidence]) -> str:
    """Return the title of a comparison: how many recordings it has, and how they were segmented."""
    count = counted(len(evidences), "recording")
    return f"{what}: log evidence of {count} by motion library, preset {STROKES.name}, offline"


def sorted_by_recording(evidences: Iterable[LibraryEvidence]) -> list[LibraryEvidence]:
    """Return evidences sorted by the name of the recording."""
    return sorted(evidences, key=lambda one: one.recording)


def _deficits(log_evidence: Mapping[str, float], per: float = 1.0) -> dict[str, float]:
    best = max(log_evidence.values())
    return {name: (value - best) / per for name, value in log_evidence.items()}


def _totals(evidences: Sequence[LibraryEvidence]) -> dict[str, float]:
    return {name: sum(one.log_evidence[name] for one in evidences) for name in LIBRARIES}


def _win_counts(evidences: Sequence[LibraryEvidence]) -> dict[str, int]:
    best = [max(one.log_evidence, key=one.log_evidence.__getitem__) for one in evidences]
    return {name: best.count(name) for name in LIBRARIES}


def grid(evidences: Sequence[LibraryEvidence]) -> Grid:
    """Return a table with a row per recording, and one of all of them."""
    observations = sum(one.observations for one in evidences)

    def row(name: str, n: object, values: Mapping[str, float], digits: int) -> tuple[str, ...]:
        return (name, str(n), *(f"{values[library]:.{digits}f}" for library in LIBRARIES))

    rows = [row(one.recording, one.observations, _deficits(one.log_evidence), 1) for one in evidences]
    total = _totals(evidences)
    rows.append(row("total", observations, _deficits(total), 1))
    rows.append(row("per observation", "", _deficits(total, observations), 3))
    rows.append(row("best in", len(evidences), _win_counts(evidences), 0))
    return Grid(NOTE, ("recording", "n", *LIBRARIES), tuple(rows))


def page(evidences: Sequence[LibraryEvidence], heading: str, missing: Sequence[str]) -> GridPage:
    """Return the table of the results. missing: notes on recordings without a result."""
    return GridPage(heading, [grid(evidences)], missing)


def as_json(evidences: Sequence[LibraryEvidence], heading: str, missing: Sequence[str]) -> dict[str, Any]:
    """Return the log evidences as plain values. missing: as in `page`."""
    total = _totals(evidences)
    return {
        "title": heading,
        "unit": "nats",
        "total": total,
        "best_in": _win_counts(evidences),
        "per_recording": [
            {"recording": one.recording, "observations": one.observations, "log_evidence": one.log_evidence}
            for one in evidences
        ],
        "missing": list(missing),
    }
