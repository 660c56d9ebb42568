"""An arm that is tilted or hangs has the results of the same arm on a table, in its own base frame."""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from caesura_protocol.codec import decode, encode
from caesura_protocol.formats.read import load_recording
from caesura_protocol.messages import Insert, Open, Relabel
from caesura_protocol.recording import Recording
from caesura_protocol.rotations import upright_rotation
from caesura_service.changepoint.compiled_filter import CompiledRunLengthFilter
from caesura_service.changepoint.presets import PRESETS
from caesura_service.changepoint.run_length_filter import RunLengthFilter
from caesura_service.conditioned_recording import condition
from caesura_service.offline_segmentation import batches, opening_of
from caesura_service.program.interpretation import carried_loads
from caesura_service.program.program_segment import Context, ProgramSegment
from caesura_service.segmentation.pipeline import SegmentationPipeline, make_pipeline
from caesura_service.segmentation.pipeline_interface import Pipeline, PipelineView
from caesura_service.segmentation.segmenter import filter_of
from caesura_service.signals.tare import RestCriterion, tare_of
from harness.segmentations import segmented
from harness.tilted import about_z, tilted

DATA = Path(__file__).parents[3] / "data"
REAL = Path(os.environ.get("CAESURA_REAL_DATA", DATA.parents[1] / "shared" / "data" / "real"))
MOUNTINGS = {
    "ceiling": (0.0, 0.0, -1.0),
    "wall": (1.0, 0.0, 0.0),
    "nearly ceiling": (1e-7, 0.0, -1.0),
    "leaning": (0.48, -0.6, 0.64),
}
SEGMENT_VECTORS = (
    "position_start",
    "position_end",
    "force_start",
    "force_end",
    "force_held",
    "turn",
    "centre",
)


@cache
def recorded(name: str) -> Recording:
    file = REAL / f"{name}.npz" if name.startswith("kit") else DATA / f"{name}.npz"
    if not file.exists():
        pytest.skip(f"no {file}: see scripts/real_recordings.py")
    return load_recording(file)


@cache
def on_a_table(name: str, yaw: float) -> PipelineView:
    return segmented(tilted(recorded(name), about_z(yaw), None))


def unit(values: tuple[float, float, float]) -> tuple[float, float, float]:
    x, y, z = (np.array(values) / np.linalg.norm(values)).tolist()
    return x, y, z


def mounted(name: str, up: tuple[float, float, float], yaw: float = 0.0, *, states: bool = True) -> Recording:
    """A recording on an arm whose base has `up` away from gravity."""
    upright = upright_rotation(unit(up))
    assert upright is not None
    return tilted(recorded(name), upright.T @ about_z(yaw), unit(up) if states else None)


def assert_turned(view: PipelineView, table: PipelineView, up: tuple[float, float, float]) -> None:
    """The results are those on a table, and their vectors are turned into the tilted base frame."""
    turn = upright_rotation(unit(up))
    assert turn is not None
    assert [one.t for one in view.changepoints] == pytest.approx([one.t for one in table.changepoints])
    assert [one.kind for one in view.segments] == [one.kind for one in table.segments]
    for one, other in zip(view.segments, table.segments, strict=True):
        assert (one.t0, one.tn) == pytest.approx((other.t0, other.tn))
        assert one.probability == pytest.approx(other.probability, abs=1e-6)
        assert (one.load_kg, one.load_sd_kg) == pytest.approx((other.load_kg, other.load_sd_kg), abs=1e-6)
        for name in SEGMENT_VECTORS:
            assert (getattr(one, name) is None) == (getattr(other, name) is None)
            if getattr(one, name) is not None:
                np.testing.assert_allclose(getattr(one, name) @ turn.T, getattr(other, name), atol=1e-9)
    assert [app.kind for app in view.apps] == [app.kind for app in table.apps]
    for app, other in zip(view.apps, table.apps, strict=True):
        assert app.load_kg == pytest.approx(other.load_kg, abs=1e-6)
        for own, others in zip(vectors_of(app), vectors_of(other), strict=True):
            np.testing.assert_allclose(own @ turn.T, others, atol=1e-6)
    assert [hint.kind for hint in view.hints] == [hint.kind for hint in table.hints]


def vectors_of(app: Any) -> Iterator[np.ndarray]:
    """Target, path and force of an app, each (n, 3)."""
    yield np.array([] if app.target is None else [app.target]).reshape(-1, 3)
    points = () if app.path is None else (app.path.start, *app.path.via)
    yield np.array([point.position for point in points]).reshape(-1, 3)
    yield np.array([] if app.force is None else [app.force]).reshape(-1, 3)


# --- whole demonstrations -------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("mounting", MOUNTINGS)
@pytest.mark.parametrize("name", ["pick_and_place", "dispenser", "wiping", "kit_panda_1"])
def test_a_mounting_changes_no_boundary_no_kind_and_no_load(name, mounting):
    up = MOUNTINGS[mounting]
    assert_turned(segmented(mounted(name, up)), on_a_table(name, 0.0), up)


@pytest.mark.slow
@settings(max_examples=4, deadline=None)
@given(
    up=st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda up: np.linalg.norm(up) > 0.1 and any(up[:2])),
    yaw=st.floats(-3.0, 3.0),
)
def test_nor_does_any_rotation(up, yaw):
    """The models see the recording turned about the vertical: by as much as the rotation turns about it."""
    name = "pick_and_place"
    table = segmented(tilted(recorded(name), about_z(yaw), None))
    assert_turned(segmented(mounted(name, up, yaw)), table, up)


@pytest.mark.parametrize("mounting", ["ceiling", "wall"])
def test_without_the_direction_the_load_is_another_one(mounting):
    view = segmented(mounted("pick_and_place", MOUNTINGS[mounting], states=False))
    right, found = (
        [one.load_kg for one in of.segments if (one.load_kg or 0.0) > 0.1]
        for of in (on_a_table("pick_and_place", 0.0), view)
    )
    assert right == pytest.approx([0.250, 0.236], abs=1e-3)
    assert not any(abs(load - 0.25) < 0.05 for load in found)


def test_an_upright_base_that_is_stated_changes_no_number():
    for name in ("pick_and_place", "wiping"):
        stated = segmented(tilted(recorded(name), np.eye(3), (0.0, 0.0, 1.0)))
        assert stated.segments == on_a_table(name, 0.0).segments
        assert stated.apps == on_a_table(name, 0.0).apps


def test_nothing_is_turned_where_the_base_is_upright():
    for up in (None, (0.0, 0.0, 1.0)):
        assert begun(tilted(recorded("wiping"), np.eye(3), up))._history._upright is None


def test_the_note_on_the_wrench_states_the_direction():
    note = segmented(mounted("pick_and_place", MOUNTINGS["ceiling"])).wrench.note
    assert "contact and load are on, with -z of the base upwards. " in note
    assert "z axis points up" not in note
    leaning = segmented(mounted("pick_and_place", MOUNTINGS["leaning"])).wrench.note
    assert "with (0.48, -0.6, 0.64) in the base frame upwards. " in leaning
    assert ", for a base whose z axis points up. " in on_a_table("pick_and_place", 0.0).wrench.note


# --- replay and corrections -----------------------------------------------------------------------------


def begun(recording: Recording) -> SegmentationPipeline:
    pipeline = make_pipeline(opening_of(recording, "default"), "default")
    assert isinstance(pipeline, SegmentationPipeline)
    return pipeline


def whole(pipeline: Pipeline, recording: Recording) -> Pipeline:
    for samples in batches(recording):
        pipeline.push(samples)
    pipeline.finish()
    return pipeline


def test_an_opening_of_the_journal_gives_the_same_results():
    recording = mounted("pick_and_place", MOUNTINGS["leaning"])
    opening = opening_of(recording, "default")
    packed = encode(opening)
    kept = decode(packed.payload, packed.encoding, Open)
    assert kept == opening
    again = whole(make_pipeline(kept, "default"), recording).view
    assert again == whole(begun(recording), recording).view
    assert again.up == recording.up


def test_a_correction_is_the_same_on_every_mounting():
    up = MOUNTINGS["leaning"]
    tables, walls = tilted(recorded("pick_and_place"), np.eye(3), None), mounted("pick_and_place", up)
    table, wall = whole(begun(tables), tables), whole(begun(walls), walls)
    for action in (Insert(t=3.3), Relabel(t=3.3, kind="steady")):
        corrected = [one.corrected([one.resolve(action)]).view for one in (wall, table)]
        assert_turned(*corrected, up)


# --- its parts ------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_numpy_and_compiled_code_agree_on_a_tilted_base():
    seen = condition(mounted("dispenser", MOUNTINGS["leaning"]))
    preset = PRESETS["default"]
    own = filter_of(preset, seen.layout.source, tared=True, orientation=True, torque=seen.layout.has_torque)
    assert isinstance(own, CompiledRunLengthFilter)
    reference = RunLengthFilter(own.lattice, preset.hazard, preset.filter)
    for observed in seen.inputs[:150]:
        own.step(observed)
        reference.step(observed)
    np.testing.assert_allclose(own.log_joint, reference.log_joint, rtol=1e-9)
    assert own.starts.tolist() == reference.starts.tolist()


@given(st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda up: np.linalg.norm(up) > 0.1))
def test_the_rotation_is_the_least_one_that_turns_up_to_z(up):
    turn = upright_rotation(unit(up))
    if turn is None:
        assert unit(up) == pytest.approx((0.0, 0.0, 1.0), abs=1e-11)
        return
    np.testing.assert_allclose(turn @ unit(up), (0.0, 0.0, 1.0), atol=1e-9)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    angle = np.arctan2(np.hypot(*unit(up)[:2]), unit(up)[2])
    assert 0.5 * (np.trace(turn) - 1.0) == pytest.approx(np.cos(angle), abs=1e-9)


def test_a_force_that_scatters_aslant_is_a_tare_on_every_base_or_on_none():
    # It was measured on the worst axis: 0.35 N of 0.5 N along a diagonal of two axes.
    draw = np.random.default_rng(0)
    aslant = draw.normal(size=(200, 1)) * np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
    aslant /= aslant.std(axis=0).max() * np.sqrt(2.0)
    for scatter, is_tared in ((0.48, True), (0.52, False)):
        for _ in range(20):
            turn, _ = np.linalg.qr(draw.normal(size=(3, 3)))
            tare = tare_of(scatter * aslant @ turn.T, np.zeros(200), RestCriterion(0.01, 0.5))
            assert (tare.bias is not None) is is_tared


@pytest.mark.parametrize("mounting", MOUNTINGS)
def test_the_weight_of_a_tool_at_the_start_is_no_press(mounting):
    up = unit(MOUNTINGS[mounting])
    weight, aside = np.array(up) * -25.0, np.array(up) * 25.0
    criterion, rest = RestCriterion(0.01, 1.0), np.zeros(5)
    assert not tare_of(np.tile(weight, (5, 1)), rest, criterion, up=up).may_be_contact
    assert tare_of(np.tile(aside, (5, 1)), rest, criterion, up=up).may_be_contact
    assert tare_of(np.tile(weight, (5, 1)), rest, criterion).may_be_contact


def test_what_hangs_on_the_robot_pulls_against_up():
    table = on_a_table("pick_and_place", 0.0)
    lifted = next(one for one in table.segments if one.kind == "transport")
    read = {"kind": "sliding", "contact": "contact", "load_kg": None, "load_sd_kg": None}
    for up in (unit(up) for up in MOUNTINGS.values()):
        pulled = lifted.model_copy(update={**read, "force_end": tuple(-5.0 * value for value in up)})
        pulled = pulled.model_copy(update={"force_held": pulled.force_end})
        step = ProgramSegment(0, pulled, 1.0)
        hangs = carried_loads.hanging(step, (), Context((), lambda t: None, up))  # type: ignore[arg-type,return-value]
        assert hangs.segment.contact == "transport"
        assert hangs.segment.load_kg == pytest.approx(5.0 / 9.81)
        assert carried_loads.hanging(step, (), Context((), lambda t: None)) is step  # type: ignore[arg-type,return-value]
