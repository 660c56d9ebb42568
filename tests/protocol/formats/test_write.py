"""What cannot be written is said before a demonstration, not after it."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from caesura_protocol.errors import CaesuraError
from caesura_protocol.formats.write import WRITERS, check_writable, whole_file
from caesura_protocol.recording import Recording
from clients.examples import recording


def test_where_it_can_be_written_nothing_is_said(tmp_path: Path):
    check_writable(tmp_path / "x.npz")
    check_writable(tmp_path / "x.mcap", ".mcap")


@pytest.mark.parametrize(
    ("name", "why"),
    [("x.txt", "suffix '.txt'"), ("nowhere/x.npz", "no such directory"), ("folder.npz", "it is a directory")],
)
def test_what_cannot_be_written_is_named(tmp_path: Path, name: str, why: str):
    (tmp_path / "folder.npz").mkdir()
    with pytest.raises(CaesuraError, match=f"cannot write .*{name}: {why}"):
        check_writable(tmp_path / name)


@pytest.mark.parametrize("name", ["x.npz", "x.csv"])
def test_what_was_there_stays_where_the_new_one_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
):
    path = tmp_path / name
    WRITERS[path.suffix](path, recording(10))
    before = path.read_bytes()
    monkeypatch.setattr(Recording, "matrix", failing)
    monkeypatch.setattr(np, "savez_compressed", half_written)
    with pytest.raises(OSError, match="disk full"):
        WRITERS[path.suffix](path, recording(20))
    assert path.read_bytes() == before
    assert [*tmp_path.iterdir()] == [path]


def failing(*_: object) -> None:
    raise OSError("disk full")


def half_written(path: Path, **_: object) -> None:
    path.write_bytes(b"half")
    raise OSError("disk full")


def test_a_directory_that_we_may_not_write_in_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) != tmp_path)  # root may write anywhere
    with pytest.raises(CaesuraError, match="permission denied"):
        check_writable(tmp_path / "x.npz")


def test_what_a_link_leads_to_is_written(tmp_path):
    """A device, such as /dev/stdout, is not replaced by a file."""
    link, file = tmp_path / "link.csv", tmp_path / "file.csv"
    link.symlink_to(file)
    with whole_file(link) as part:
        part.write_text("whole")
    assert link.is_symlink()
    assert file.read_text() == "whole"
