"""What several modules look at; nothing is changed in it."""

from __future__ import annotations

from pathlib import Path

import pytest

from caesura_protocol.formats.read import load_recording
from caesura_protocol.recording import Recording
from caesura_service.segmentation.pipeline_interface import Pipeline
from service.segmentation.corrected import whole


@pytest.fixture(scope="session")
def shown() -> Pipeline:
    """A whole demonstration without corrections."""
    return whole()


@pytest.fixture(scope="session")
def taught() -> Recording:
    return load_recording(Path(__file__).parents[3] / "data" / "pick_and_place.npz")
