"""What cannot be written is said before a demonstration, not after it."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from caesura_protocol.errors import CaesuraError
from caesura_protocol.formats.write import (
    WRITERS,
    check_new,
    check_not_read,
    check_writable,
    whole_file,
)
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


def test_what_is_read_is_not_replaced_by_what_is_made_of_it(tmp_path: Path):
    file, link = tmp_path / "x.npz", tmp_path / "link.npz"
    check_not_read(tmp_path / "new.npz", [file])
    file.write_bytes(b"taught")
    link.symlink_to(file)
    for out in (file, link, tmp_path / "." / "x.npz"):
        with pytest.raises(CaesuraError, match="npz: it is the file that is read; name another file"):
            check_not_read(out, [tmp_path / "absent.npz", file])


def test_a_file_that_exists_is_not_new(tmp_path: Path):
    check_new(tmp_path / "x.npz")
    check_new(Path(os.devnull))
    (tmp_path / "x.npz").write_bytes(b"taught")
    with pytest.raises(CaesuraError, match="it exists; name another file, or move it away"):
        check_new(tmp_path / "x.npz")


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
