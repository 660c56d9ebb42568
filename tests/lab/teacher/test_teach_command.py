from __future__ import annotations

import json
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from caesura_lab.teacher.command_registration import register
from caesura_lab.teacher.scenarios import SCENARIOS
from caesura_protocol.formats.read import load_recording


@pytest.fixture(scope="module")
def app() -> typer.Typer:
    """A command line with the teacher's commands and one more, as the real one has."""
    app = typer.Typer()
    register(app)
    app.command("other")(lambda: None)
    return app


def test_teach_writes_a_recording_and_its_truth(app: typer.Typer, tmp_path: Path) -> None:
    file = tmp_path / "new" / "eight.npz"
    options = ["--seed", "3", "--out", str(file), "--rate", "200", "--wrench-source", "none"]
    result = CliRunner().invoke(app, ["teach", "parkour", *options])
    assert result.exit_code == 0, result.output
    recording, truth = load_recording(file), json.loads(file.with_suffix(".ann.json").read_text())
    assert recording.wrench_source == "none"
    assert truth["file"] == "eight.npz"
    assert truth["window"][1] == pytest.approx(recording.t[-1], abs=0.006)


@pytest.mark.parametrize("name", ["button.npz", "button.ann.json"])
def test_an_existing_recording_or_annotation_is_not_replaced(
    app: typer.Typer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """`caesura teach button` replaced a recording of that name, and the annotation that a person had made."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).write_text("of a person")
    result = CliRunner().invoke(app, ["teach", "button"])
    assert result.exit_code == 1
    assert result.stderr == f"error: cannot write {name}: it exists; name another file, or move it away\n"
    assert [one.read_text() for one in tmp_path.iterdir()] == ["of a person"]


def test_a_directory_that_cannot_be_made_is_named(app: typer.Typer, tmp_path: Path) -> None:
    """A traceback, after the demonstration was simulated."""
    (tmp_path / "file").touch()
    result = CliRunner().invoke(app, ["teach", "button", "-o", str(tmp_path / "file" / "a.npz")])
    assert result.exit_code == 1
    assert result.stderr.endswith("a.npz: File exists\n")


def test_list_shows_every_scenario(app: typer.Typer) -> None:
    output = CliRunner().invoke(app, ["teach", "--list"]).output
    assert all(name in output for name in SCENARIOS)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["juggling"], "pick_and_place"),
        (["button", "--wrench-source", "magic"], "joint_torque_estimate"),
        (["button", "--profile", "jerky"], "lognormal"),
        (["button", "--rate", "5000"], "1000"),
        (["button", "--out", "x.csv"], ".npz"),
    ],
)
def test_misuse_names_what_would_do(app: typer.Typer, arguments: list[str], named: str) -> None:
    result = CliRunner().invoke(app, ["teach", *arguments], env={"COLUMNS": "300", "TERM": "dumb"})
    assert result.exit_code == 2
    assert named in result.output
