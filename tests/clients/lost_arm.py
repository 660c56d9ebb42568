"""Reads a source of a live arm until the arm is lost."""

from __future__ import annotations

import numpy as np
import pytest

from caesura_clients.bridge.sources.live_arm import LiveArm
from caesura_protocol.errors import SourceError


def chunks_of(source: LiveArm) -> tuple[list[np.ndarray], str]:
    """All chunks until the arm is lost, and the error's text."""
    chunks, reported = [], source.chunks()
    try:
        for chunk in reported:
            chunks.append(chunk)
    except SourceError as lost:
        return chunks, str(lost)
    pytest.fail("the arm was not lost")
