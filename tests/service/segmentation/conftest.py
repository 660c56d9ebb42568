"""What several modules look at; nothing is changed in it."""

from __future__ import annotations

import pytest

from caesura_service.segmentation.pipeline_interface import Pipeline
from service.segmentation.corrected import whole


@pytest.fixture(scope="session")
def shown() -> Pipeline:
    """A whole demonstration without corrections."""
    return whole()
