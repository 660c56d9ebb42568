"""`caesura export --format lerobot`: recordings as the episodes of a dataset, without a service."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from caesura_protocol.messages import WrenchSource
from harness.commands import application
from harness.demonstrations import guided


def caesura(*args: object):
    return CliRunner().invoke(application(), [str(arg) for arg in args])


@pytest.fixture
def taught(tmp_path: Path) -> Path:
    directory = tmp_path / "taught"
    directory.mkdir()
    for name in ("one", "two"):
        guided().save(directory / f"{name}.npz")
    return directory


def test_recordings_become_episodes_by_their_names(taught: Path, tmp_path: Path):
    """They had to be played through a service, and read from its journal."""
    out = tmp_path / "demos"
    stated = ("--task", "press", "--success", "--failed", "two", "--fps", "50")
    done = caesura("export", taught, "-o", out, "--format", "lerobot", *stated)
    assert done.exit_code == 0, done.output
    assert done.stdout == f"{out}: 2 episodes, 540 frames at 50 Hz\n"
    rows = pq.read_table(out / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [(row["session"], row["success"], row["tasks"]) for row in rows] == [
        ("one", True, ["press"]),
        ("two", False, ["press"]),
    ]
    assert "press" in pq.read_table(out / "meta/subtasks.parquet")["subtask"].to_pylist()


@pytest.mark.parametrize("source", [None, "flange_sensor"])
def test_a_wrench_that_a_dataset_leaves_out_is_named(tmp_path: Path, source: WrenchSource | None):
    """It was left out without a word."""
    replace(guided(), wrench_source=source).save(tmp_path / "open.npz")
    done = caesura("export", tmp_path / "open.npz", "-o", tmp_path / "demos", "--format", "lerobot")
    assert done.exit_code == 0, done.output
    (one,) = json.loads((tmp_path / "demos/meta/caesura.json").read_text(encoding="utf-8"))
    said = "file/open: force left out: the source of the wrench is not stated."
    assert one["left_out"] == ([said] if source is None else [])
    assert (said in done.stderr.splitlines()) == (source is None)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("taught", "-o", "a.npz"), "2 recordings for one file: several are for --format lerobot"),
        (("taught/one.npz", "-o", "a.mcap", "--fps", "5"), "--without-language are for --format lerobot"),
        (("taught", "-o", "d", "--format", "lerobot", "--failed", "three"), "exported episodes are one, two"),
        (
            ("taught/one.npz", "copy/one.npz", "-o", "d", "--format", "lerobot"),
            "would both be the episode one",
        ),
        (("taught", "-o", "taught", "--format", "lerobot"), "taught exists: a dataset is written to a new"),
    ],
)
def test_what_does_not_fit_is_one_line(
    taught: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], words: str
):
    monkeypatch.chdir(taught.parent)
    Path("copy").mkdir()
    guided().save(Path("copy/one.npz"))
    done = caesura("export", *arguments)
    assert (done.exit_code, done.stdout) == (1, "")
    assert words in done.stderr
    assert not Path("d").exists()
