"""What is acknowledged survives a power loss: the journal is replaced by what had been fsynced."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from caesura_service.journal import SqliteJournal
from harness.power import COMPILER, Power, environment
from harness.sessions import NAME, STATION

ACKNOWLEDGED = 12  # records; then the power goes
DEADLINE_S = 30.0
CHILD = """
import itertools, sys
from pathlib import Path
from caesura_service.journal import JournalSettings, Record, SqliteJournal
from harness.sessions import NAME, STATION, batch

with SqliteJournal(Path(sys.argv[1]), JournalSettings(commit_s=3600.0)) as journal:
    for seq in itertools.count():
        journal.append(Record(STATION, NAME, float(seq), batch(seq)), now=seq % 3 == 0)
        if seq % 3 == 1:
            journal.commit()
        if seq % 3 != 2:  # neither: it waits, and nobody was told
            print(seq, flush=True)
"""


@pytest.mark.skipif(COMPILER is None, reason="no C compiler")
def test_nothing_acknowledged_is_forgotten_by_a_power_loss(tmp_path: Path):
    power = Power(tmp_path / "journal", tmp_path)
    path = power.directory / "caesura-1.sqlite"
    command = power.command([sys.executable, "-c", CHILD, str(path)])
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment())
    try:
        assert process.stdout is not None
        reported = [int(process.stdout.readline()) for _ in range(ACKNOWLEDGED)]
    finally:
        process.kill()
        process.communicate(timeout=DEADLINE_S)
    power.lose()
    with SqliteJournal(path) as journal:
        kept = {record.message.seq for record in journal.replay(STATION, NAME)}
    assert set(reported) <= kept
