"""What goes out as MCAP comes in again: the same samples, bit for bit, and the same results."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from mcap.reader import make_reader
from mcap.writer import Writer
from typer.testing import CliRunner

from caesura_lab.export.mcap_file import write_mcap as write_session
from caesura_lab.export.session_from_journal import read_session_export
from caesura_protocol.errors import CaesuraError
from caesura_protocol.formats.mcap_write import McapContent, write_mcap
from caesura_protocol.formats.read import load_recording
from caesura_protocol.formats.write import write_csv
from caesura_protocol.programs.safety import CellSettings
from caesura_protocol.recording import ASSUMED_ORDER, Recording
from caesura_service.offline_segmentation import as_json, recording_of, segment_recording
from harness.commands import application
from harness.demonstrations import guided
from lab.export.test_mcap import kept

DATA = Path(__file__).resolve().parents[3] / "data"


def assert_same(one: Recording, other: Recording) -> None:
    assert np.array_equal(one.t, other.t)
    assert list(one.signals) == list(other.signals)
    for name, values in one.signals.items():
        assert np.array_equal(values, other.signals[name]), name
    for option in ("wrench_source", "hand_on_robot", "force_frame", "length_unit"):
        assert getattr(one, option) == getattr(other, option)
    assert other.ignored == ()


def caesura(*args: object):
    return CliRunner().invoke(application(), [str(arg) for arg in args])


def test_a_session_that_is_exported_and_imported_gives_identical_results(tmp_path):
    taught = read_session_export(kept(guided()), "cell-1", "s1")
    write_session(tmp_path / "s1.mcap", taught)
    again = load_recording(tmp_path / "s1.mcap")
    assert_same(taught.recording, again)
    view = segment_recording(again)
    assert (view.segments, view.changepoints, view.apps) == (
        taught.view.segments,
        taught.view.changepoints,
        taught.view.apps,
    )


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    data=arrays(np.float64, (7, 15), elements=st.floats(-1e12, 1e12, allow_subnormal=True)),
    began=st.floats(0.0, 2e9),
    unit=st.sampled_from(["m", "cm", "mm"]),
    frame=st.sampled_from(["base", "flange"]),
    source=st.sampled_from([None, "flange_sensor", "joint_torque_estimate", "none"]),
    hand=st.sampled_from(["yes", "no", "unknown"]),
)
def test_every_finite_number_survives_mcap_and_csv(tmp_path, data, began, unit, frame, source, hand):
    t = 1e-9 * data[:, 0]  # in any order, before and after the session's zero
    signals = {"pos": data[:, 1:4], "q": data[:, 4:11], "force": data[:, 11:14], "gripper": data[:, 14:]}
    recording = Recording(
        t=t,
        signals=signals,
        wrench_source=source,
        hand_on_robot=hand,
        length_unit=unit,
        force_frame=frame,
    )
    began = max(began, -float(t.min()) + 1.0)
    reported = McapContent("cell-1", "s1", "default", recording, began, recording.columns)
    write_mcap(tmp_path / "any.mcap", reported)
    assert_same(recording, load_recording(tmp_path / "any.mcap"))
    write_csv(tmp_path / "any.csv", recording)
    assert_same(recording, load_recording(tmp_path / "any.csv"))
    recording.save(tmp_path / "any.npz")
    assert_same(recording, load_recording(tmp_path / "any.npz"))


@pytest.mark.parametrize("suffix", ["mcap", "csv", "npz"])
def test_an_order_of_quaternions_that_was_assumed_is_assumed_in_a_copy(tmp_path, suffix):
    # A copy stated it, and nothing named the assumption from then on.
    turned = np.tile([0.0, 0.0, 0.0, 1.0], (guided().t.size, 1))
    replace(guided(), signals=guided().signals | {"quat": turned}).save(tmp_path / "stated.npz")
    for name in ("stated", "open"):
        copy = tmp_path / f"{name}-copy.{suffix}"
        assert caesura("export", tmp_path / f"{name}.npz", "-o", copy).exit_code == 0
        assert (ASSUMED_ORDER in load_recording(copy).assumed) == (name == "open")
        assert load_recording(copy).ignored == ()
        left = dict(np.load(tmp_path / "stated.npz"))
        left.pop("quaternion_order")
        np.savez(tmp_path / "open.npz", **left)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["mcap", "csv", "npz"])
def test_the_command_exports_and_segment_gives_the_same_numbers(tmp_path, suffix):
    short = load_recording(DATA / "pick_and_place.npz")
    first = {s: v[:4000] for s, v in short.signals.items()}
    part = replace(short, t=short.t[:4000], signals=first, assumed=())  # a copy states it
    part.save(tmp_path / "part.npz")
    out = tmp_path / f"out.{suffix}"
    result = caesura("export", tmp_path / "part.npz", "-o", out)
    assert result.exit_code == 0, result.output
    assert_same(part, load_recording(out))
    assert caesura("segment", out, "--json", tmp_path / "a.json").exit_code == 0
    found = json.loads((tmp_path / "a.json").read_text())
    del found["origin"]  # the file
    assert found == json.loads(json.dumps(as_json(segment_recording(part))))


@pytest.mark.parametrize(
    ("file", "out", "message"),
    [
        (DATA / "button.npz", "out.txt", "expected one of .npz, .csv, .mcap"),
        (DATA / "button.npz", "nowhere/out.csv", "no such directory"),
        ("missing.mcap", "out.csv", "no such file"),
    ],
)
def test_what_cannot_be_exported_is_one_line(tmp_path, file, out, message):
    result = caesura("export", tmp_path / file, "-o", tmp_path / out)
    assert result.exit_code == 1
    assert message in result.stderr
    assert not (tmp_path / out).exists()


def test_a_foreign_mcap_is_refused_with_what_it_has(tmp_path):
    with (tmp_path / "foreign.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        writer.register_channel(topic="/camera", message_encoding="json", schema_id=0)
        writer.finish()
    with pytest.raises(CaesuraError, match=r"neither Caesura's nor a rosbag2.*/camera"):
        load_recording(tmp_path / "foreign.mcap")


@pytest.mark.parametrize("length", [0, 8, 500, -1])
def test_a_file_that_was_cut_short_is_refused_in_one_line(tmp_path, length):
    write_session(tmp_path / "s1.mcap", read_session_export(kept(guided()), "cell-1", "s1"))
    whole = (tmp_path / "s1.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[:length])
    with pytest.raises(CaesuraError, match="not a readable mcap file") as caught:
        load_recording(tmp_path / "cut.mcap")
    assert "\n" not in str(caught.value)


def test_a_damaged_file_is_refused(tmp_path):
    write_session(tmp_path / "s1.mcap", read_session_export(kept(guided()), "cell-1", "s1"))
    whole = bytearray((tmp_path / "s1.mcap").read_bytes())
    whole[len(whole) // 2] ^= 0xFF
    (tmp_path / "bad.mcap").write_bytes(whole)
    with pytest.raises(CaesuraError, match="not a readable mcap file"):
        load_recording(tmp_path / "bad.mcap")


def test_an_exported_session_keeps_the_limit_and_the_tolerances_of_its_cell(tmp_path: Path) -> None:
    whole = load_recording(DATA / "dispenser.npz")
    recording = replace(whole, t=whole.t[::5], signals={s: v[::5] for s, v in whole.signals.items()})
    asked = {"force_limit_n": 10.0, "path_tolerance_m": 0.005, "path_tolerance_rad": 0.05}
    asked |= {"robot": "panda", "up": (0.0, 0.0, 1.0)}
    journal = kept(recording, **asked)
    write_session(tmp_path / "taught.mcap", read_session_export(journal, "cell-1", "s1"))
    recording_of(journal.replay("cell-1", "s1")).save(tmp_path / "taught.npz")
    write_csv(tmp_path / "taught.csv", load_recording(tmp_path / "taught.npz"))
    for suffix in ("mcap", "npz", "csv"):
        read = load_recording(tmp_path / f"taught.{suffix}")
        assert read.setting._asdict() == asked
        assert read.ignored == ()
    forces = [app.force for app in segment_recording(read).apps if app.force is not None]
    assert [np.linalg.norm(force) for force in forces] == pytest.approx([10.0, 10.0])
    other = segment_recording(read, setting=CellSettings(force_limit_n=15.0))
    assert other.force_limit_n == 15.0  # what is asked for goes before what the file states


def test_an_export_with_a_limit_has_it_in_its_program_and_its_phases(tmp_path: Path) -> None:
    out, cell = tmp_path / "wiped.mcap", tmp_path / "cell.json"
    cell.write_text('{"force_n": 10.0}', encoding="utf-8")
    command = ["export", str(DATA / "wiping.npz"), "-o", str(out), "--cell", str(cell)]
    done = CliRunner().invoke(application(), command)
    assert done.exit_code == 0, done.output
    found: dict[str, list[Any]] = {"/program": [], "/phases": []}
    with out.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages(list(found)):
            found[channel.topic].append(json.loads(message.data))
    (program,) = found["/program"]
    assert program["force_limit_n"] == 10.0
    pressed = [app["force"] for app in program["apps"] if "force" in app]
    assert max(np.linalg.norm(force) for force in pressed) == pytest.approx(10.0)
    assert [phase["kind"] for phase in found["/phases"]] == ["free", "contact", "free"]
