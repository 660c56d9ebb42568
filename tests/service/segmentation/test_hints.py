"""Hints of a whole session: a function of its samples, and without effect on its results."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from caesura_protocol.messages import Hints, Insert, WrenchSource
from caesura_protocol.recording import Recording
from caesura_protocol.rotations import upright_rotation
from caesura_service.offline_segmentation import batches, opening_of
from caesura_service.publishing import state_updates
from caesura_service.publishing.events import Owner
from caesura_service.publishing.session_state import SessionCounters, snapshot_of
from caesura_service.segmentation.pipeline import make_pipeline
from caesura_service.segmentation.pipeline_interface import PipelineView
from caesura_service.sessions.restored_outcome import view_from_snapshot
from harness.demonstrations import guided
from harness.segmentations import segmented
from harness.tilted import tilted

FAULT_S = 3.6  # [s] when the last reach of the demonstration begins


@pytest.fixture(scope="module")
def held() -> Recording:
    """A demonstration of which the hand has hold of the tool from FAULT_S on."""
    clean = guided()
    velocity = np.gradient(clean.signals["pos"], clean.t, axis=0)
    speed = np.linalg.norm(velocity, axis=1)[:, None]
    push = 14.0 * velocity / np.maximum(speed, 0.05) * (clean.t > FAULT_S)[:, None]
    return replace(clean, signals={**clean.signals, "force": clean.signals["force"] + push})


def steps(recording: Recording) -> list[PipelineView]:
    pipeline = make_pipeline(opening_of(recording), "default")
    found = []
    for samples in batches(recording):
        pipeline.push(samples)
        found.append(pipeline.view)
    pipeline.finish()
    return [*found, pipeline.view]


def test_a_hand_is_hinted_at_while_it_holds_and_no_hint_is_active_at_the_end(held: Recording):
    found = steps(held)
    raised = next(view for view in found if any(one.kind == "hand_in_wrench" for one in view.hints))
    assert held.t[raised.samples - 1] - FAULT_S <= 0.5
    assert [one.until for one in raised.hints] == [None]
    assert all(one.until is not None for one in found[-1].hints)


def laden(recording: Recording) -> Recording:
    """Something heavy is in the fingers from 2 s on."""
    shut = (recording.t > 2.0).astype(float)[:, None]
    force = recording.signals["force"] + shut * [0.0, 0.0, -12.0]
    return replace(recording, signals={**recording.signals, "force": force, "gripper": shut})


@pytest.mark.parametrize("up", [(0.0, 0.0, -1.0), (0.48, -0.6, 0.64)])
def test_the_hints_of_a_tilted_arm_are_those_of_one_on_a_table(held: Recording, up):
    turn = upright_rotation(up)
    for recording in (held, laden(held)):
        table, tilt = (steps(one)[-1].hints for one in (recording, tilted(recording, turn.T, up)))
        assert [(one.kind, one.since, one.until) for one in tilt] == [
            (one.kind, one.since, one.until) for one in table
        ]
        assert "hand_in_wrench" in {one.kind for one in table}


def test_a_load_that_sinks_passes_for_a_hand_where_the_direction_is_not_stated():
    whole, up = laden(guided()), (0.0, 0.0, -1.0)
    lowered = whole.signals["pos"] * [1.0, 1.0, -1.0]  # the last reach leads down
    recording, turn = replace(whole, signals={**whole.signals, "pos": lowered}), upright_rotation(up)
    assert steps(tilted(recording, turn.T, up))[-1].hints == ()
    assert steps(tilted(recording, turn.T, None))[-1].hints != ()


def test_samples_cut_otherwise_give_the_same_hints(held: Recording):
    pipeline = make_pipeline(opening_of(held), "default")
    pipeline.push(np.concatenate([*batches(held)]))
    pipeline.finish()
    assert pipeline.view.hints == steps(held)[-1].hints != ()


def test_a_correction_in_the_end_gives_the_hints_of_one_from_the_start(held: Recording):
    late = make_pipeline(opening_of(held), "default")
    for samples in batches(held):
        late.push(samples)
    edits = [late.resolve(Insert(t=1.0))]
    early = make_pipeline(opening_of(held), "default").corrected(edits)
    for samples in batches(held):
        early.push(samples)
    corrected = late.corrected(edits)
    for one in (early, corrected):
        one.finish()
    assert corrected.view.hints == early.view.hints


def test_lost_samples_are_asked_for():
    whole = guided()
    kept = (whole.t < 2.0) | (whole.t > 2.6)
    signals = {name: values[kept] for name, values in whole.signals.items()}
    found = segmented(replace(whole, t=whole.t[kept], signals=signals))
    assert [(one.kind, round(one.since, 1)) for one in found.hints] == [("show_again", 2.6)]


def frozen(recording: Recording, from_s: float, *, turning: bool) -> Recording:
    """The sensor repeats its force from then on; turning: in the axes of a flange that turns all the time."""
    force = recording.signals["force"].copy()
    force[recording.t > from_s] = force[recording.t > from_s][0]
    signals = {**recording.signals, "force": force}
    if not turning:
        return replace(recording, signals=signals)
    half = 0.1 * recording.t
    signals["quat"] = np.column_stack([np.sin(half), 0.0 * half, 0.0 * half, np.cos(half)])
    return replace(recording, signals=signals, force_frame="flange")


@pytest.mark.parametrize("turning", [False, True])
@pytest.mark.parametrize("source", ["flange_sensor", None])
def test_a_force_that_freezes_is_hinted_at_while_the_robot_moves(source: WrenchSource | None, turning: bool):
    recording = replace(frozen(guided(), FAULT_S, turning=turning), wrench_source=source)
    view = next(view for view in steps(recording) if any(one.kind == "frozen_force" for one in view.hints))
    assert 0.5 <= recording.t[view.samples - 1] - FAULT_S <= 1.0
    (hint,) = [one for one in view.hints if one.kind == "frozen_force"]
    newest = recording.signals["force"][-1]
    assert f"The force stays at exactly {np.linalg.norm(newest):.1f} N while" in hint.text


@pytest.mark.parametrize(("source", "named"), [("flange_sensor", True), (None, False)])
def test_a_program_names_a_force_that_froze_where_contacts_were_looked_for(
    source: WrenchSource | None, named: bool
):
    # A press that no sensor saw was a movement of the program, and no finding of a check said so.
    view = segmented(replace(frozen(guided(), FAULT_S, turning=False), wrench_source=source))
    (hint,) = [one for one in view.hints if one.kind == "frozen_force"]
    said = [one for one in view.notes if one.startswith("The force stayed the same number")]
    assert [
        f"first until {hint.since:.1f} s: contacts and loads were not detected" in one for one in said
    ] == ([True] * named)


def test_a_force_of_zeros_is_hinted_at_and_a_session_without_a_wrench_is_not():
    silent = guided()
    silent = replace(silent, signals={**silent.signals, "force": np.zeros((silent.t.size, 3))})
    assert {one.kind for one in segmented(silent).hints} == {"frozen_force"}
    assert segmented(replace(silent, wrench_source="none")).hints == ()


def test_a_late_subscriber_has_the_active_hints_from_the_snapshot(held: Recording):
    view = next(view for view in steps(held) if view.hints)
    opening = opening_of(held)
    empty = make_pipeline(opening, "default").view
    state = state_updates.initial_state("cell-1", "s1", Owner("one", 1), "default", empty)
    state, _ = state_updates.initial_messages(state)
    assert snapshot_of(state).hints is None
    state, published = state_updates.apply_view(state, view, SessionCounters())
    (sent,) = [one.message for one in published if isinstance(one.message, Hints)]
    assert sent == snapshot_of(state).hints
    assert (sent.seq, sent.hints) == (0, view.hints)
    state, published = state_updates.apply_view(
        state, view._replace(hints=tuple(view.hints)), SessionCounters()
    )
    assert published == []
    assert view_from_snapshot(snapshot_of(state)).hints == view.hints
