"""`caesura rerun`: what a station's messages become in a file of Rerun's, which its own tool reads."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rerun", reason="rerun-sdk is not installed (extra rerun)")

from caesura_clients.session_state_reader import SessionReader
from caesura_clients.viewer.live_mcap_messages import LiveStation
from caesura_clients.viewer.rerun_sink import RerunSink
from caesura_protocol.codec import pack_samples
from caesura_protocol.errors import CaesuraError
from clients.conftest import free_port
from clients.examples import snapshot

COLUMNS = ("t", "px", "py", "pz", "fx", "fy", "fz", "gripper")
ROWS = 400
BEGAN = 1_773_480_413.0


def printed(file: Path) -> str:
    command = [str(Path(sys.executable).with_name("rerun")), "rrd", "print", "-v", str(file)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    return done.stdout


def rows_of(entity: str, content: str) -> int:
    """The rows of an entity in all chunks of a file."""
    return sum(map(int, re.findall(rf"with (\d+) rows \([^)]*\) - {entity} - ", content)))


def test_samples_and_results_are_in_the_file(tmp_path: Path):
    file, station, reader = tmp_path / "live.rrd", LiveStation(), SessionReader()
    reader.restart(snapshot(1, "motion", "contact", certainty="final"))
    assert reader.update is not None
    t = np.arange(ROWS) / 100.0
    matrix = np.column_stack([t, *(np.full(ROWS, 0.1 * i) for i in range(7))])
    with RerunSink("cell-1", file=file) as sink:
        for message in station.updated(reader.update, BEGAN):
            sink.publish(message)
        for seq in range(ROWS // 20):
            rows = matrix[20 * seq : 20 * seq + 20]
            batch = pack_samples(rows, COLUMNS, session=reader.update.session, epoch=0, seq=seq)
            for message in station.sampled(batch, BEGAN + rows[-1, 0]):
                sink.publish(message)
        sink.state(reader.update.session, 2)
    content = printed(file)
    for entity, rows in (
        ("/state/pos", ROWS),
        ("/state/gripper", ROWS),
        ("/wrench/force", ROWS),
        ("/flange", ROWS),
    ):
        assert rows_of(entity, content) == rows, entity
    for entity in ("/path", "/segments", "/program", "/log/segments", "/log"):
        assert rows_of(entity, content) >= 1, entity


def test_without_a_viewer_it_says_so_at_once():
    with (
        pytest.raises(CaesuraError, match="no Rerun viewer answers"),
        RerunSink("cell-1", viewer=f"rerun+http://127.0.0.1:{free_port()}/proxy"),
    ):
        pass
