"""The folder of received recordings: when it is made, and that nothing is left of it, also after −9."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from caesura_clients.dashboard.recordings import RecordingDesk
from caesura_clients.dashboard.upload_folder import UploadFolder
from harness.processes import DEADLINE_S, started

HOLDS = """
import sys, tempfile, threading
from caesura_clients.dashboard.upload_folder import UploadFolder
tempfile.tempdir = sys.argv[1]
(UploadFolder().path / "recording.csv").write_text("1")
print("ready", flush=True)
threading.Event().wait()
"""


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_a_dashboard_that_receives_nothing_makes_no_folder(temporary: Path):
    with RecordingDesk(None, None):
        assert list(temporary.iterdir()) == []


def test_it_is_made_for_the_first_file_and_removed_with_it_at_the_end(temporary: Path):
    with RecordingDesk(None, None) as desk:
        desk.begin_file("u-1", "a.csv").write_text("1")
        desk.begin_file("u-2", "b.csv").write_text("1")
        assert len(list(temporary.iterdir())) == 1
    assert list(temporary.iterdir()) == []


def test_that_of_another_process_stays_until_it_was_killed(temporary: Path):
    command = [sys.executable, "-c", HOLDS, str(temporary)]
    with started(command, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "ready\n"
        (folder,) = temporary.iterdir()
        with RecordingDesk(None, None):
            assert (folder / "recording.csv").exists()
        other.kill()
        other.wait(DEADLINE_S)
        with RecordingDesk(None, None):
            assert list(temporary.iterdir()) == []


def test_what_only_has_such_a_name_stays(temporary: Path):
    own = UploadFolder()
    link = own.path.with_name("caesura-recordings-link")
    link.symlink_to(temporary / "kept")
    (temporary / "kept").mkdir()
    with RecordingDesk(None, None):
        assert (link.exists(), own.path.exists()) == (True, True)
    own.remove()
