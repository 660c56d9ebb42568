"""The commands of the page and what it answers, without a browser."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

from caesura_clients.dashboard import server
from caesura_clients.dashboard.compression import FileCompression
from caesura_lab.annotation.edits import AnnotationEditor, EditError
from caesura_lab.annotation.page import AnnotationSession
from caesura_lab.annotation.signals import plotted_signals
from caesura_protocol.recording import Recording
from caesura_protocol.session_time_display import clock_from

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


DAY_S = 1_700_000_000.125  # when a recording with times of day begins


@pytest.fixture
def of_day(session: AnnotationSession) -> AnnotationSession:
    document = {**EMPTY, "window": [DAY_S, DAY_S + 10.0]}
    signals = session.signals._replace(t=session.signals.t + DAY_S)
    editor = AnnotationEditor(document)
    return session._replace(editor=editor, signals=signals, clock=clock_from(DAY_S))


def test_times_of_day_are_shown_from_the_start_and_kept_as_they_are(of_day: AnnotationSession):
    """Every time on the page had ten digits before the point."""
    assert of_day.run_command("start", 2.0) == "start at 2.000 s"
    of_day.run_command("second", 2.2)
    assert of_day.run_command("motion", 3.0) == "motion from 2.00 to 10.00 s"
    shown = of_day.state()
    assert shown["window"] == [0.0, 10.0]
    assert [(point["t"], point["t_alt"], point["tol"]) for point in shown["points"]] == [(2.0, 2.2, 0.15)]
    assert [(one["t0"], one["t1"], one["cls"]) for one in shown["segments"]] == [(2.0, 10.0, "motion")]
    assert of_day.signals.as_payload(of_day.clock.start_s)["t"][:2] == [0.0, 0.1]
    kept = of_day.editor.document
    assert (kept["changepoints"][0]["t"], kept["changepoints"][0]["t_alt"]) == (DAY_S + 2.0, DAY_S + 2.2)
    with pytest.raises(EditError, match=r"^12\.000 s is outside of the window from 0\.000 to 10\.000 s$"):
        of_day.run_command("stop", 12.0)
    assert of_day.run_command("save", 2.0) == f"saved {of_day.path}"


def test_an_annotation_without_a_mark_or_a_file_is_not_called_saved(session: AnnotationSession):
    def standing() -> tuple[bool, bool]:
        state = session.state()
        return state["saved"], state["stored"]

    assert standing() == (True, False)
    session.run_command("start", 2.0)
    assert standing() == (False, False)
    session.run_command("save", 2.0)
    assert standing() == (True, True)


def test_no_page_of_the_dashboard_is_built_before_a_browser_asks(monkeypatch: pytest.MonkeyPatch):
    """`caesura annotate` built the dashboard's page of a station, and printed that it was not found."""
    added: dict[type, dict[str, Any]] = {}
    monkeypatch.setattr(server.app, "add_middleware", lambda kind, **named: added.update({kind: named}))
    monkeypatch.setattr(server.app, "on_startup", lambda _: None)
    monkeypatch.setattr(server.ui, "run", lambda **_: None)
    monkeypatch.setattr(server, "bound_logs", lambda: None)
    server.run(server.Address("127.0.0.1", 8081))
    assert added[FileCompression]["prepared"] is None
