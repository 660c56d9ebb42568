"""A result is kept for later runs under a digest of all that its function imports."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from caesura_protocol.keys import check_name
from caesura_protocol.robots import robot_description
from harness import once
from harness.once import KEPT, RUN, imported_by, once_a_version

TEACHER = "caesura_lab.teacher.simulated_teaching"


@pytest.fixture
def folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folders of a run and of a cache that nothing else uses."""
    for name in (RUN, KEPT):
        (tmp_path / name).mkdir()
        monkeypatch.setenv(name, str(tmp_path / name))
    return tmp_path / KEPT


def checked() -> list[Path]:
    """Compute in a process that knows nothing yet; the files that are kept then."""
    assert once_a_version(check_name)("cell-1", "station") == "cell-1"
    return [one for one in Path(os.environ[KEPT]).rglob("*") if one.is_file()]


def test_a_later_run_reads_what_was_computed(folders, monkeypatch):
    (kept,) = checked()
    written = kept.stat().st_mtime_ns
    (another := folders.with_name("another run")).mkdir()
    monkeypatch.setenv(RUN, str(another))
    assert checked()[0].stat().st_mtime_ns == written


def test_another_version_is_computed_anew_and_the_old_one_is_removed(folders, monkeypatch):
    (before,) = checked()
    monkeypatch.setattr(once, "version_of", lambda module: "another")
    (after,) = checked()
    assert (before.name, before.parent) != (after.name, after.parent)
    assert not before.exists()


@pytest.mark.parametrize("changed", ["module", "data", "processor"])
def test_the_version_changes_with_what_computes(folders, monkeypatch, tmp_path, changed):
    once_here = once.version_of.__wrapped__
    before = once_here(TEACHER)
    assert before == once_here(TEACHER)
    robots = robot_description("panda").urdf_path
    files = set(once._files_of(imported_by(TEACHER)))
    assert robots in files
    if changed == "processor":
        monkeypatch.setattr(once, "_processor", lambda: "another")
    else:
        name = robots if changed == "data" else next(one for one in files if one.name == "guided_arm.py")
        other = tmp_path / "other"
        other.write_bytes(name.read_bytes() + b"\n")
        monkeypatch.setattr(once, "_files_of", lambda _: {*files - {name}, other})
    assert once_here(TEACHER) != before


def test_what_is_imported_in_a_function_or_by_way_of_another_counts():
    found = imported_by(TEACHER)
    assert {"caesura_lab.teacher.guided_arm", "caesura_service.robot.robot_model", "caesura_lab"} <= found
    assert "caesura_clients.cli" not in found
