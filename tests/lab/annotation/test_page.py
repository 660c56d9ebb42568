"""The commands of the page and what it answers, without a browser."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

from caesura_lab.annotation.editing import AnnotationEditor
from caesura_lab.annotation.page import AnnotationSession
from caesura_lab.annotation.signals import plotted_signals
from caesura_protocol.recording import Recording

EMPTY = {"file": "x.npz", "window": [0.0, 10.0], "changepoints": [], "segments": []}
T = np.arange(101) / 10.0


@pytest.fixture
def session(tmp_path: Path) -> AnnotationSession:
    signals = plotted_signals(Recording(T, {"pos": np.outer(T, [0.1, 0.0, 0.0])}, wrench_source="none"))
    return AnnotationSession("x.npz", tmp_path / "x.ann.json", AnnotationEditor(EMPTY), signals)


def test_the_answer_to_a_class_at_a_changepoint_is_the_segment_that_got_it(session: AnnotationSession):
    """The cursor goes from changepoint to changepoint; the answer named the segment before."""
    session.run_command("start", 2.0)
    session.run_command("steady", 1.0)
    assert session.run_command("motion", 2.0) == "motion from 2.00 to 10.00 s"
    assert session.run_command("steady", 2.0) == "steady from 2.00 to 10.00 s"
