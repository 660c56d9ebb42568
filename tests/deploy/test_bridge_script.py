"""The script that the bridge's unit runs: which session it begins, and which one it takes up."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from caesura_protocol.keys import check_name

SCRIPT = Path(__file__).parents[2] / "deploy" / "systemd" / "caesura-bridge"


class Unit:
    """The unit of one station: starts the script with a `caesura` that only says how it was called."""

    def __init__(self, folder: Path, take_up: str) -> None:
        said = folder / "caesura"
        said.write_text('#!/bin/sh\necho "$@"\n')
        said.chmod(0o755)
        own = {
            "STATE_DIRECTORY": str(folder),
            "CAESURA": str(said),
            "CAESURA_TAKE_UP": take_up,
            "CAESURA_STANDBY": "no",
        }
        self._environment = {**os.environ, **own, "CAESURA_BRIDGE": "--source teacher --scenario button"}
        self.file = folder / "session"

    def start(self) -> tuple[str, int]:
        """Session and epoch that it began with."""
        words = self._run("run", "cell-1", "--zenoh-config", "a file.json5").split()
        assert words[:3] == ["bridge", "--station", "cell-1"]
        assert words[-7:] == [
            *("--source", "teacher", "--scenario", "button", "--zenoh-config"),
            *("a", "file.json5"),
        ]
        return check_name(words[words.index("--session") + 1], "session"), int(
            words[words.index("--epoch") + 1]
        )

    def standby(self) -> list[str]:
        """How `caesura` was called by a unit whose file states nothing."""
        self._environment.pop("CAESURA_STANDBY")
        return self._run("run", "cell-1", "--zenoh-config", "a file.json5").split()

    def end(self, code: str) -> None:
        self._run("ended", "cell-1", EXIT_CODE=code)

    def _run(self, *arguments: str, **extra: str) -> str:
        environment = {**self._environment, **extra}
        done = subprocess.run(
            ["sh", str(SCRIPT), *arguments], capture_output=True, text=True, env=environment, check=True
        )
        return done.stdout


@pytest.fixture
def unit(tmp_path):
    return Unit(tmp_path, "yes")


def test_a_bridge_that_crashed_goes_on_with_its_session(unit):
    name, epoch = unit.start()
    assert epoch == 0
    unit.end("killed")
    assert unit.start() == (name, 1)
    assert unit.start() == (name, 2), "the power failed, and nobody was told"


def test_one_that_ended_by_itself_is_followed_by_a_new_session(unit):
    first, _ = unit.start()
    unit.end("exited")
    second, epoch = unit.start()
    assert epoch == 0
    assert first != second


def test_nothing_is_taken_up_unless_the_source_allows_it(tmp_path):
    unit = Unit(tmp_path, "no")
    first, _ = unit.start()
    unit.end("killed")
    second, epoch = unit.start()
    assert (second != first, epoch) == (True, 0)


def test_a_file_that_was_cut_short_is_not_believed(unit):
    unit.file.write_text("")
    assert unit.start()[1] == 0


def test_it_stands_by_unless_the_file_states_otherwise(unit):
    unit.start()
    words = unit.standby()
    assert words[:4] == ["bridge", "--station", "cell-1", "--standby"]
    assert not {"--session", "--epoch"} & set(words), "each start opens a session of its own"
    assert not unit.file.exists(), "and none is taken up later"
