"""Samples in another unit than they are said to have: refused at every door, unless the unit is declared."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from caesura_clients.bridge.bridge import Bridge
from caesura_clients.bridge.sources.paced_source import PacedSource
from caesura_lab.teacher.scenarios import SCENARIOS
from caesura_protocol.codec import pack_samples
from caesura_protocol.errors import SourceError
from caesura_protocol.formats.read import load_recording
from caesura_protocol.messages import Close, Quantity
from caesura_protocol.plausibility import FirstSecond, implausible
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from caesura_service.app import Service
from caesura_service.config import ServiceConfig
from caesura_service.offline_segmentation import opening_of
from harness.commands import application
from harness.demonstrations import guided
from harness.peer import Peer
from lab.teacher.nominal import nominal_once

DATA = Path(__file__).parents[2] / "data"
LOCAL = ServiceConfig(instance="test-1", listen="tcp/127.0.0.1:0")
CASES = {  # what a file holds, times what, and what a user reads
    "mm": ("pos", 1e3, "positions are 487.1 m away from the base, at most 5 m", "--length-unit mm"),
    "cm": ("pos", 1e2, "positions are 48.71 m away from the base, at most 5 m", "--length-unit cm"),
    "ms": ("t", 1e3, "samples are 1 s apart, at most 0.5 s", "--time-unit ms"),
    "us": ("t", 1e6, "samples are 1000 s apart, at most 0.5 s", "--time-unit us"),
    "ns": ("t", 1e9, "samples are 1e+06 s apart, at most 0.5 s", "--time-unit ns"),
    "deg": ("q", 180 / math.pi, "joints turn to 161.3 rad, at most 6.3 rad", "--angle-unit deg"),
    "mN": ("force", 1e3, "forces reach 1.14e+04 N, at most 1000 N", "--force-unit mN"),
}


def caesura(*words: object):
    return CliRunner().invoke(application(), [str(word) for word in words])


def other_unit(folder: Path, unit: str) -> Path:
    """The recording of a button, one signal in another unit than the file says."""
    signal, factor, _, _ = CASES[unit]
    arrays = dict(np.load(DATA / "button.npz"))
    np.savez(folder / f"{unit}.npz", **{**arrays, signal: factor * arrays[signal]})
    return folder / f"{unit}.npz"


@pytest.mark.parametrize("unit", CASES)
def test_every_command_refuses_it_with_the_value_the_limit_and_the_likely_unit(tmp_path: Path, unit: str):
    file, (_, _, found, option) = other_unit(tmp_path, unit), CASES[unit]
    written = {"json": tmp_path / "out.json", "report": tmp_path / "out.html", "export": tmp_path / "out.npz"}
    for command in (
        ["segment", file, "--json", written["json"]],
        ["report", file, "--out", written["report"]],
        ["export", file, "--out", written["export"]],
        ["bridge", "--source", "file", "--file", file, "--connect", "tcp/127.0.0.1:9"],
    ):
        done = caesura(*command)
        assert done.exit_code == 1
        assert done.stderr.startswith(f"error: {unit}.npz: {found} are plausible: probably in {unit}. ")
        assert f"State {option}, or " in done.stderr
    assert not any(path.exists() for path in written.values())
    done = caesura("doctor", "--file", file)
    assert done.exit_code == 1
    assert found in done.output
    assert option in done.output


def test_a_declared_unit_is_converted(tmp_path: Path):
    metres = load_recording(DATA / "button.npz")
    for unit, (signal, _, _, option) in CASES.items():
        name, value = option.removeprefix("--").replace("-", "_").split()
        found = load_recording(other_unit(tmp_path, unit), **{name: value})  # type: ignore[arg-type]
        if signal == "pos":
            assert found.length_unit == unit
        else:
            there = metres.t if signal == "t" else metres.signals[signal]
            here = found.t if signal == "t" else found.signals[signal]
            np.testing.assert_allclose(here, there, rtol=1e-12)


def test_a_declared_unit_is_believed(tmp_path: Path):
    out = tmp_path / "out.json"
    done = caesura("segment", other_unit(tmp_path, "mm"), "--length-unit", "m", "--json", out)
    assert done.exit_code == 0, done.output
    assert json.loads(out.read_text())["segments"]


def test_a_unit_that_does_not_exist_is_refused_with_those_that_do():
    done = caesura("segment", DATA / "button.npz", "--time-unit", "min")
    assert done.exit_code == 1
    assert "error: --time-unit is 'min', expected one of s, ms, us, ns" in done.stderr


@pytest.mark.parametrize("declared", [(), ("length",)])
def test_the_service_refuses_it_and_another_station_is_not_disturbed(declared: tuple[Quantity, ...]):
    """A bridge that does not check its units, in another language."""
    recording = guided()
    batches = len(recording.t) // 20
    with Service(LOCAL) as service, Peer(service.endpoint) as peer:
        for station, factor in (("cell-1", 1000.0), ("cell-2", 1.0)):
            opening = opening_of(recording).model_copy(update={"session": "s1", "declared_units": declared})
            peer.command(opening, station)
            matrix = recording.matrix()
            matrix[:, 1:4] *= factor
            for seq in range(batches):
                rows = matrix[20 * seq : 20 * seq + 20]
                peer.send(pack_samples(rows, opening.columns, session="s1", epoch=0, seq=seq), station)
            peer.command(Close(session="s1", last_seq=batches - 1), station)
        millimetres, metres = peer.snapshot("s1", "cell-1"), peer.snapshot("s1", "cell-2")
    assert metres.status.refused == {}
    assert metres.program.apps
    if declared:
        assert millimetres.status.refused == {}
        return
    assert millimetres.status.refused == {"malformed": batches}
    assert millimetres.status.last_refusal is not None
    said = millimetres.status.last_refusal.message
    assert "implausible: positions are" in said
    assert "m away from the base, at most 5 m are plausible: probably in mm" in said
    assert millimetres.program.apps == ()


def test_a_bridge_refuses_a_live_source_in_its_first_second():
    recording = guided()
    matrix = recording.matrix()
    matrix[:, 1:4] *= 1000.0
    source = PacedSource(
        lambda: iter(np.array_split(matrix, 100)),
        columns=recording.columns,
        wrench_source="flange_sensor",
        pace=math.inf,
    )
    with Service(LOCAL) as service, ZenohTransport(service.endpoint, timeout_s=20.0) as transport:
        with (
            Bridge(transport, "cell-1", source, session="s1") as bridge,
            pytest.raises(SourceError, match=r"the source: positions are .* probably in mm. State --length"),
        ):
            bridge.run()
        with Peer(service.endpoint) as peer:
            status = peer.snapshot("s1", "cell-1").status
    assert (status.state, status.samples, status.refused) == ("closed", 0, {})


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_what_is_taught_in_the_right_units_is_plausible(scenario: str):
    recording = nominal_once(scenario).recording
    assert implausible(recording.t, recording.signals) is None
    first = FirstSecond(recording.columns, "m", ())
    assert [first.check(rows) for rows in np.array_split(recording.matrix()[:1200], 60)] == 60 * [None]


REAL = Path(__file__).parents[2].parent / "shared" / "data" / "real"


@pytest.mark.parametrize(
    "file", [*sorted(DATA.glob("*.npz")), *sorted(REAL.glob("*.npz"))], ids=lambda f: f.stem
)
def test_every_recording_is_plausible(file: Path):
    recording = load_recording(file)
    matrix = recording.matrix()
    first = FirstSecond(recording.columns, recording.length_unit, ())
    assert [first.check(rows) for rows in np.array_split(matrix, 50)] == 50 * [None]


def test_a_wild_sample_and_a_leap_are_no_other_unit():
    t = np.arange(1000) / 1000
    pos = np.tile([0.4, 0.0, 0.3], (1000, 1))
    pos[:100] = 0.0  # before the first message of its source
    pos[500] = 1e5
    assert implausible(t, {"pos": pos}) is None


@pytest.mark.parametrize(
    ("option", "doubt"),
    [
        (["--length-unit", "mm"], "positions are within 0.000"),
        (["--time-unit", "ms"], "samples are 1e-06 s apart"),
        (["--force-unit", "mN"], "forces reach 0.0"),
    ],
)
def test_a_unit_declared_in_the_wrong_direction_is_doubted(option: list[str], doubt: str):
    # `--length-unit mm` of a file in metres gave a path of 0.5 mm without a word.
    shown = " ".join(caesura("segment", DATA / "button.npz", *option).output.split())
    _, _, said = shown.partition(doubt)
    assert "is the declared unit right?" in said, shown


def test_a_declared_unit_that_no_robot_has_is_doubted(tmp_path: Path):
    found = load_recording(other_unit(tmp_path, "mm"), length_unit="m")
    assert "at most 5 m are plausible: is the declared unit right?" in found.doubts[0]


def test_forces_in_kilonewtons_are_doubted_and_a_clean_recording_is_not():
    recording = load_recording(DATA / "button.npz")
    assert recording.doubts == ()
    kilo = {**recording.signals, "force": recording.signals["force"] / 1000}
    (doubt,) = replace(recording, signals=kilo).doubts
    assert "are they in kN? State --force-unit kN" in doubt
    assert replace(recording, signals=kilo, wrench_source="joint_torque_estimate").doubts == ()


def test_the_doctor_looks_at_a_table_of_other_software(tmp_path: Path):
    """As recordings.md states it: the option was missing."""
    with np.load(DATA / "button.npz") as taught:
        rows = np.column_stack([taught["t"] * 1e3, taught["pos"] * 1e3])[::10]
    log, mapping = tmp_path / "log.csv", tmp_path / "log.toml"
    np.savetxt(log, rows, delimiter=";", header="Zeit [ms];X;Y;Z", comments="", fmt="%.6f")
    columns = "".join(f'p{one.lower()} = {{ column = "{one}", unit = "mm" }}\n' for one in "XYZ")
    mapping.write_text(f'delimiter = ";"\n[time]\ncolumn = "Zeit [ms]"\nunit = "ms"\n[columns]\n{columns}')
    done = caesura("doctor", "--file", log, "--mapping", mapping)
    assert done.exit_code == 0, done.output
    assert "100 Hz" in done.output


def test_a_way_that_is_too_fast_within_reach_is_not_taken_for_centimetres():
    """It was said to be probably in cm: then the flange would be 4 mm from the base."""
    t = np.arange(1000) / 200
    pos = np.column_stack([np.full(1000, 0.4), 0.3 * np.sin(10.0 * t), np.full(1000, 0.3)])
    found = implausible(t, {"pos": pos})
    assert found is not None
    assert (found.quantity, found.likely) == ("length", None)
    in_cm = implausible(t, {"pos": 100.0 * pos})
    assert in_cm is not None
    assert in_cm.likely == "cm"
