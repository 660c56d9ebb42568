"""What cannot be written is said before a demonstration, not after it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from caesura_clients.errors import CaesuraError
from caesura_clients.formats.write import check_writable


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


def test_a_directory_that_we_may_not_write_in_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) != tmp_path)  # root may write anywhere
    with pytest.raises(CaesuraError, match="permission denied"):
        check_writable(tmp_path / "x.npz")
