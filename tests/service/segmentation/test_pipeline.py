"""Samples in, segments out: what must not change them, and what a wrench source switches off."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest

from caesura_protocol import messages as wire
from caesura_protocol.errors import ProtocolError
from caesura_protocol.formats.read import load_recording
from caesura_protocol.messages import COLUMNS_OF_SIGNAL
from caesura_protocol.plausibility import UNITS
from caesura_protocol.recording import Recording, RecordingError
from caesura_service.constants import JOINTS, JOINTS_MOST
from caesura_service.cooperative_scheduler import Slices
from caesura_service.offline_segmentation import batches, opening_of, segment_recording
from caesura_service.program import BEGINS_MOVING, ENDS_MOVING
from caesura_service.segmentation import notes_on_parts_in_no_app as notes_module
from caesura_service.segmentation.pipeline import make_pipeline
from caesura_service.segmentation.pipeline_interface import PipelineView
from caesura_service.signals.sample_layout import SIGNALS
from caesura_service.signals.wrench_capabilities import FORCE_FRAMES, HANDS_ON_ROBOT, WRENCH_SOURCES
from harness.demonstrations import guided
from harness.segmentations import segmented

DATA = Path(__file__).parents[3] / "data"


@pytest.fixture(scope="module")
def found(taught: Recording) -> PipelineView:
    return segmented(taught)


def changed(recording: Recording, **signals: np.ndarray) -> Recording:
    """The recording with some signals replaced and without those that would contradict them."""
    kept = {name: values for name, values in recording.signals.items() if name not in {"q", "quat", "torque"}}
    return replace(recording, signals=MappingProxyType(kept | signals))


def boundaries(view: PipelineView) -> list[tuple[float, float, str]]:
    return [(one.t0, one.tn, one.kind) for one in view.segments]


def test_moving_the_origin_changes_no_boundary_and_no_class(taught: Recording, found: PipelineView):
    moved = segmented(changed(taught, pos=taught.signals["pos"] + [1.0, -1.0, 1.0]))
    assert boundaries(moved) == boundaries(found)


def test_turning_the_base_changes_no_boundary_and_no_class(taught: Recording, found: PipelineView):
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turned = {name: taught.signals[name] @ quarter.T for name in ("pos", "force")}
    assert boundaries(segmented(changed(taught, **turned))) == boundaries(found)


def test_turning_the_base_by_any_angle_about_the_vertical_changes_nothing(
    taught: Recording, found: PipelineView
):
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    turned = {name: taught.signals[name] @ turn.T for name in ("pos", "force")}
    assert boundaries(segmented(changed(taught, **turned))) == boundaries(found)


@pytest.mark.parametrize(("unit", "per_metre"), [("mm", 1000.0), ("cm", 100.0)])
def test_a_declared_unit_changes_no_boundary_and_no_class(
    taught: Recording, found: PipelineView, unit: str, per_metre: float
):
    scaled = replace(changed(taught, pos=per_metre * taught.signals["pos"]), length_unit=unit)  # type: ignore[arg-type]
    assert boundaries(segmented(scaled)) == boundaries(found)


def test_times_may_begin_anywhere(taught: Recording, found: PipelineView):
    later = segmented(replace(changed(taught), t=taught.t + 1000.0))
    np.testing.assert_allclose(
        [(one.t0 - 1000.0, one.tn - 1000.0) for one in later.segments],
        [(one.t0, one.tn) for one in found.segments],
        atol=0.011,
    )
    assert [one.kind for one in later.segments] == [one.kind for one in found.segments]


@pytest.mark.parametrize("later_s", [-5.0, 0.7, 12.3])
def test_forces_of_a_program_do_not_depend_on_when_its_recording_begins(later_s: float):
    """An observation at the very end of a segment was counted or not, as the times were rounded: 0.06 N."""
    wiping = load_recording(DATA / "wiping.npz")
    later = segmented(replace(wiping, t=wiping.t + later_s))
    for app, before in zip(later.apps, segmented(wiping).apps, strict=True):
        assert app.kind == before.kind
        assert (app.force or ()) == pytest.approx(before.force or (), abs=1e-6)
        assert app.t0 - later_s == pytest.approx(before.t0, abs=1e-6)


def test_a_mirrored_demonstration_has_the_mirrored_program():
    polar, axial, turn = np.array([-1.0, 1.0, 1.0]), np.array([1.0, -1.0, -1.0]), [1.0, -1.0, -1.0, 1.0]
    factors = {"pos": polar, "quat": np.array(turn), "force": polar, "torque": axial}
    wiping = load_recording(DATA / "wiping.npz")
    mirrored = {name: wiping.signals[name] * factor for name, factor in factors.items()}
    view, seen = (segmented(changed(wiping, **kept)) for kept in (wiping.signals, mirrored))
    assert [one.model_dump(include={"t0", "tn", "kind", "probability"}) for one in seen.segments] == [
        one.model_dump(include={"t0", "tn", "kind", "probability"}) for one in view.segments
    ]
    for app, twin in zip(view.apps, seen.apps, strict=True):
        assert (twin.kind, twin.confidence) == (app.kind, app.confidence)
        for field in ("target", "force"):
            here, there = getattr(app, field), getattr(twin, field)
            assert (there is None) == (here is None)
            np.testing.assert_allclose(there or (), polar * here if here else (), atol=1e-9)


def test_signs_of_quaternions_and_samples_that_come_twice_change_nothing(
    taught: Recording, found: PipelineView
):
    rng = np.random.default_rng(0)
    signs = rng.choice([-1.0, 1.0], (taught.t.size, 1))
    order = np.sort(np.concatenate([np.arange(taught.t.size), rng.integers(0, taught.t.size, 500)]))
    signals = taught.signals | {"quat": signs * taught.signals["quat"]}
    awkward = replace(taught, t=taught.t[order], signals={k: v[order] for k, v in signals.items()})
    view = segmented(awkward)
    assert view.repeats == 500
    assert (view.segments, view.apps, view.phases) == (found.segments, found.apps, found.phases)


def test_joints_alone_give_the_segments_of_the_poses_that_they_reach(taught: Recording, found: PipelineView):
    joints = {name: taught.signals[name] for name in ("q", "force", "gripper")}
    by_joints = segmented(replace(taught, signals=MappingProxyType(joints)))
    assert [one.kind for one in by_joints.segments] == [one.kind for one in found.segments]
    assert by_joints.apps[0].joints is not None


def test_segments_join_without_gaps_or_overlaps(found: PipelineView):
    for before, after in zip(found.segments, found.segments[1:], strict=False):
        assert before.tn == after.t0
    assert [one.t for one in found.changepoints] == [one.t0 for one in found.segments[1:]]
    assert {one.certainty for one in found.segments} == {"final"}


def test_a_hole_in_the_samples_is_a_gap_between_segments_and_not_bridged(taught: Recording):
    view = segmented(without(taught, 5.0, 5.6))
    (gap,) = view.gaps
    assert (gap.t0, gap.tn, gap.reason) == (
        pytest.approx(5.0, abs=0.01),
        pytest.approx(5.6, abs=0.01),
        "source",
    )
    before = max(one.tn for one in view.segments if one.tn <= gap.tn)
    after = min(one.t0 for one in view.segments if one.t0 >= gap.t0)
    assert before <= gap.t0 + 0.05
    assert after >= gap.tn - 0.05
    assert view.notes == (
        view.wrench.note.partition(" Tared")[0],
        *taught.assumed,
        "Not observed: 5.00–5.60 s (the source paused). What was taught then is missing, and apps beside it "
        "are less sure.",
    )


def without(recording: Recording, t0: float, tn: float) -> Recording:
    there = (recording.t < t0) | (recording.t > tn)
    signals = {name: values[there] for name, values in recording.signals.items()}
    return replace(recording, t=recording.t[there], signals=MappingProxyType(signals))


def test_apps_beside_a_hole_are_less_sure_and_the_others_are_not(taught: Recording):
    holed = without(taught, 5.0, 5.6)
    view = segmented(holed)
    (gap,) = view.gaps
    starts = {one.t: one.probability for one in view.changepoints}
    checked = set()
    for app in view.apps:
        mine = [view.segments[i] for i in app.segments]
        sure = [starts.get(one.t0, 1.0) for one in mine] + [starts.get(one.tn, 1.0) for one in mine]
        beside = app.t0 - 0.2 <= gap.tn and gap.t0 <= app.tn + 0.2
        if beside:
            lost, seen = gap.tn - gap.t0, app.tn - app.t0
            assert app.confidence <= seen / (seen + lost)
        elif mine:
            assert app.confidence >= 0.999 * min(one.probability for one in mine) * min(sure)
        checked.add(beside)
    assert checked == {True, False}


def test_samples_that_are_lost_divide_and_are_named_as_lost(taught: Recording):
    every = list(batches(taught))
    pipeline = make_pipeline(opening_of(taught, "default"), "default")
    for number, samples in enumerate(every):
        if 20 <= number < 24:
            pipeline.declare_gap()
        else:
            pipeline.push(samples)
    pipeline.finish()
    (gap,) = pipeline.view.gaps
    assert (gap.t0, gap.tn, gap.reason) == (every[19][-1, 0], every[24][0, 0], "evicted")
    assert any(one.tn <= gap.t0 + 0.05 for one in pipeline.view.segments)
    assert not [one for one in pipeline.view.segments if one.t0 < gap.t0 - 0.05 and one.tn > gap.tn + 0.05]
    assert "(samples were lost)" in pipeline.view.notes[-1]


def test_a_lost_beginning_and_a_lost_end_are_gaps_without_a_length(taught: Recording):
    first, second = list(batches(taught))[:2]
    pipeline = make_pipeline(opening_of(taught, "default"), "default")
    pipeline.declare_gap()
    for samples in (first, second):
        pipeline.push(samples)
    pipeline.declare_gap()
    pipeline.finish()
    assert [(gap.t0, gap.tn) for gap in pipeline.view.gaps] == [(t, t) for t in (first[0, 0], second[-1, 0])]
    note = pipeline.view.notes[-1]
    for words in (f"before {first[0, 0]:.2f} s", f"after {second[-1, 0]:.2f} s"):
        assert words in note


def test_a_recording_that_is_cut_in_a_movement_says_so(taught: Recording, found: PipelineView):
    assert not {BEGINS_MOVING, ENDS_MOVING} & set(found.notes)
    longest = max((one for one in found.segments if one.kind == "motion"), key=lambda one: one.tn - one.t0)
    middle = 0.5 * (longest.t0 + longest.tn)
    assert segmented(without(taught, middle, math.inf)).notes[-1] == ENDS_MOVING
    late = segmented(without(taught, -math.inf, middle))
    assert BEGINS_MOVING in late.notes
    assert ENDS_MOVING not in late.notes


@pytest.mark.parametrize("source", ["flange_sensor_with_hand", "joint_torque_estimate", "none"])
def test_a_wrench_that_cannot_show_contact_is_not_asked_and_the_program_says_so(
    taught: Recording, source: str
):
    view = segmented(replace(changed(taught), wrench_source=source))  # type: ignore[arg-type]
    assert {one.contact for one in view.segments} == {"free"}
    assert not view.wrench.contact_models
    assert view.notes


def test_an_unknown_preset_is_refused_with_those_that_exist(taught: Recording):
    with pytest.raises(ProtocolError, match="unknown preset") as refused:
        segment_recording(taught, "magic")
    assert {"default", "without_power"} <= set(refused.value.expected)


def test_a_value_that_is_not_finite_is_refused_with_its_place(taught: Recording):
    pos = taught.signals["pos"].copy()
    pos[1234, 1] = np.nan
    with pytest.raises(RecordingError, match="sample 1234: py is nan"):
        segment_recording(changed(taught, pos=pos))


def test_an_hour_long_pause_anywhere_is_a_gap(taught: Recording):
    pause = 3000.0 * (np.arange(taught.t.size) >= 6007)
    view = segmented(replace(taught, t=taught.t + pause))
    assert [(gap.t0, gap.reason) for gap in view.gaps] == [(pytest.approx(6.006), "source")]


def test_a_time_that_goes_back_is_refused_with_its_place(taught: Recording):
    back = 3.0 * (np.arange(taught.t.size) >= 6001)
    with pytest.raises(ValueError, match=r"^sample 6001: time goes back"):
        segment_recording(replace(taught, t=taught.t - back))


def test_a_hand_in_an_estimate_makes_no_press_of_what_is_carried(taught: Recording) -> None:
    """Contacts were not looked for, and yet the change of a hand's force was a stroke, which pulled."""
    carried = (taught.t > 4.3) & (taught.t < 5.6)
    pushed = taught.signals["force"] + np.outer(carried, (12.0, 0.0, 0.0))
    estimate = replace(changed(taught, force=pushed), wrench_source="joint_torque_estimate")
    made = segmented(estimate)
    assert [app.kind for app in made.apps] == [
        "cartesian_motion",
        "grasp",
        "hold",
        "transport",
        "transport",
        "hold",
        "gripper_move",
        "cartesian_motion",
    ]


def test_shaking_that_ten_poses_a_second_miss_is_a_note() -> None:
    """Up to 9.7 mm of it were in no app, and nothing stated that."""
    still = guided()
    shaken_s = np.arange(600) / 200
    beside = np.clip(np.minimum(shaken_s - 0.3, 2.5 - shaken_s) / 0.2, 0.0, 1.0)
    aside = 0.02 * beside * np.sin(2.0 * np.pi * 5.0 * shaken_s + 0.4)
    t = np.arange(still.t.size + 600) / 200
    signals = {
        name: np.vstack([values, np.repeat(values[-1:], 600, axis=0)])
        for name, values in still.signals.items()
    }
    signals["pos"][still.t.size :, 0] += aside
    said = "The hand moved too fast for ten poses a second, first at "
    notes = segmented(replace(still, t=t, signals=MappingProxyType(signals))).notes
    assert [note.startswith(said) for note in notes].count(True) == 1
    assert not any(note.startswith(said) for note in segmented(still).notes)


def test_turning_back_and_forth_that_ten_poses_a_second_miss_is_a_note() -> None:
    """Shaking by 20° was one straight movement, and nothing stated that."""
    still = guided()
    after_s = np.maximum(still.t - still.t[-1] + 2.5, 0.0)
    half = 0.5 * 0.35 * np.clip(after_s / 0.2, 0.0, 1.0) * np.sin(2.0 * np.pi * 5.0 * after_s)
    none = np.zeros_like(half)
    said = "The hand moved too fast for ten poses a second, first at "
    for turns, count in ((half, 1), (none, 0)):
        quat = np.column_stack([np.cos(turns), np.sin(turns), none, none])
        signals = MappingProxyType({**still.signals, "quat": quat})
        notes = segmented(replace(still, signals=signals)).notes
        assert [note.startswith(said) for note in notes].count(True) == count


def test_a_torque_that_is_held_in_a_press_while_nothing_turns_is_a_note() -> None:
    """Taught at half the pace, so that the press lasts."""
    still = guided()
    pressed = (still.signals["force"][:, 2] > 6.0).astype(np.float64)
    said = "Torques that no app exerts, because nothing turned: a torque of 2.0 Nm about the force at "
    for newton_metres, count in ((2.0, 1), (0.0, 0)):
        torque = np.outer(pressed, (0.0, 0.0, newton_metres))
        level = np.tile((1.0, 0.0, 0.0, 0.0), (still.t.size, 1))
        signals = MappingProxyType({**still.signals, "quat": level, "torque": torque})
        notes = segmented(replace(still, t=2.0 * still.t, signals=signals)).notes
        assert [note.startswith(said) for note in notes].count(True) == count


def test_shaking_ten_times_a_second_and_fingers_that_open_for_a_moment_are_notes() -> None:
    """Both lie between ten observations a second."""
    still = guided()
    t = still.t
    rests = (t > 2.95) & (t < 3.45)
    shaken = still.signals["pos"] + np.outer(0.005 * np.sin(20.0 * np.pi * t) * rests, (1.0, 0.0, 0.0))
    flicked = np.where((t > 1.02) & (t < 1.08), 0.07, 0.03)[:, None]
    notes = segmented(changed(still, **{**still.signals, "pos": shaken, "gripper": flicked})).notes
    for said in (
        "The hand moved too fast",
        "Taught and in no app: the fingers from 30 to 70 mm at 1.0–1.1 s",
    ):
        assert [note.startswith(said) for note in notes].count(True) == 1
    assert not [note for note in segmented(changed(still)).notes if "too fast" in note]


def test_a_changepoint_lies_in_its_interval(found: PipelineView):
    for one in found.changepoints:
        assert one.t_low <= one.t <= one.t_high
        assert one.t_high - one.t_low <= 1.0
    assert min(one.t_high - one.t_low for one in found.changepoints) <= 0.25


def test_the_wire_and_the_signals_name_the_same_columns():
    """The core sees no message, so the names stand twice; they must not drift apart."""
    assert dict(SIGNALS) == COLUMNS_OF_SIGNAL
    assert set(WRENCH_SOURCES) == set(wire.WRENCH_SOURCES)
    assert set(HANDS_ON_ROBOT) == set(wire.HANDS_ON_ROBOT)
    assert set(FORCE_FRAMES) == set(wire.FORCE_FRAMES)
    assert set(UNITS["length"]) == set(wire.LENGTH_UNITS)
    assert JOINTS == wire.JOINTS
    assert JOINTS_MOST == wire.JOINTS_MOST == len(COLUMNS_OF_SIGNAL["q"]) == len(COLUMNS_OF_SIGNAL["tau"])


def test_a_view_says_in_which_unit_and_frame_its_samples_came(taught: Recording):
    view = segmented(replace(taught, length_unit="mm", force_frame="flange"))
    assert (view.length_unit, view.wrench.frame) == ("mm", "flange")


@pytest.mark.parametrize(
    "note", ["detours", "unreproduced_torques_note", "unreproduced_pulls_note", "unreproduced_touches_note"]
)
def test_the_notes_on_a_long_program_give_way_at_each_app(monkeypatch, taught, note):
    """At the end of 15 minutes they took 0.2 s in one slice, in which the worker served no station."""
    made, inside, slices = make_pipeline(opening_of(taught), "default"), [False], Slices(slice_s=0.0)
    noted = getattr(notes_module, note)

    def watched(*given):
        inside[0] = True
        found = noted(*given)
        found = found if found is None or isinstance(found, str) else list(found)
        inside[0] = False
        return found

    monkeypatch.setattr(notes_module, note, watched)
    made.push(taught.matrix())
    done, interrupted = slices.begin("close", made.finish), 0
    while not done:
        interrupted += inside[0]
        done = slices.go_on("close")
    assert interrupted >= len(made.view.apps) > 3
