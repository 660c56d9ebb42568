"""What is assumed of a recording, and what of it is not used, is shown by every command that reads it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from caesura_clients.bridge.sources.registry import SourceOptions
from caesura_clients.cli.bridge import _opened_source
from caesura_protocol.recording import ASSUMED_ORDER
from harness.commands import application

BUTTON = Path(__file__).parents[2] / "data" / "button.npz"
FROZEN, UNUSED = "The force is exactly (", "It is not used; contact and load are off"


def caesura(*words: object):
    return CliRunner().invoke(application(), [str(word) for word in words], env={"COLUMNS": "1000"})


@pytest.fixture(scope="module")
def frozen(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A force that is the same from 3 s on, and no joints that show the order of the quaternions."""
    path = tmp_path_factory.mktemp("frozen") / "frozen.npz"
    with np.load(BUTTON) as file:
        arrays = {name: file[name].copy() for name in file.files if name != "q"}
    after = arrays["t"] > 3.0
    for name in ("force", "torque"):
        arrays[name][after] = arrays[name][after][0]
    np.savez(path, **arrays)
    return path


def test_the_table_shows_it_and_has_no_contact(frozen: Path, tmp_path: Path):
    done = caesura("segment", frozen, "--json", tmp_path / "a.json")
    assert done.exit_code == 0, done.output
    for words in (f"Warning: {FROZEN}", UNUSED, ASSUMED_ORDER, "Wrench source none"):
        assert words in done.output
    assert "move to contact" not in done.output
    warnings = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))["warnings"]
    assert UNUSED in warnings[0]
    assert ASSUMED_ORDER in warnings


@pytest.mark.slow
def test_the_report_shows_it(frozen: Path, tmp_path: Path):
    done = caesura("report", frozen, "-o", tmp_path / "a.html")
    assert done.exit_code == 0, done.output
    written = (tmp_path / "a.html").read_text(encoding="utf-8")
    for words in (FROZEN, UNUSED, ASSUMED_ORDER):
        assert words in written


def test_a_copy_keeps_what_the_file_states(frozen: Path, tmp_path: Path):
    done = caesura("export", frozen, "-o", tmp_path / "a.npz")
    assert done.exit_code == 0, done.output
    assert ASSUMED_ORDER in done.output
    assert str(np.load(tmp_path / "a.npz")["wrench_source"]) == "flange_sensor"
    done = caesura("export", frozen, "-o", tmp_path / "a.mcap")
    assert done.exit_code == 0, done.output
    assert UNUSED in done.output, "its segments have no contact, and the reason is stated"


def test_the_doctor_names_it(frozen: Path):
    done = caesura("doctor", "--file", frozen)
    assert FROZEN in done.output
    assert ASSUMED_ORDER in done.output


def test_a_bridge_names_it_before_it_connects(frozen: Path, capsys: pytest.CaptureFixture):
    with _opened_source("file", SourceOptions(file=frozen)) as source:
        assert source.wrench_source == "none"
    printed = capsys.readouterr().err
    assert f"warning: {FROZEN}" in printed
    assert f"note: {ASSUMED_ORDER}" in printed
