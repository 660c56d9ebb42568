"""Phases of two wiped rims are those of the authors' labels. Skipped where the recordings are not at hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from caesura_protocol.formats.read import load_recording
from caesura_service.offline_segmentation import segment_recording

FOLDER = Path(__file__).parents[4] / "shared" / "data" / "real"
WITHIN_S = 0.5  # as phases are judged (docs/judge.md)


@pytest.mark.parametrize("name", ["icsc_wiping_rim_1", "icsc_wiping_rim_2"])
def test_the_rounds_of_a_wiped_rim_are_one_cycle(name: str) -> None:
    """The wrench is unstated, so contact is off, and the way alone shows where the wipe begins."""
    path = FOLDER / f"{name}.npz"
    if not path.is_file():
        pytest.skip(f"{path} is not there: real recordings are not part of the repository")
    with np.load(path) as file:
        t, label = file["t"], file["label"]
    labelled = t[np.flatnonzero(np.diff(label)) + 1]
    phases = segment_recording(load_recording(path)).phases
    assert [phase.kind for phase in phases] == ["free", "cycle", "free"]
    assert [phase.t0 for phase in phases[1:]] == pytest.approx(labelled.tolist(), abs=WITHIN_S)
