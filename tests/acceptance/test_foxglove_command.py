"""`caesura foxglove` beside a real service: a viewer receives what the service got and what it found."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from caesura_clients import connect
from caesura_clients.cli import build
from clients.fake_service import eventually
from harness.foxglove import viewing
from harness.processes import RECORDING, SESSION, serving, start, teaching

STATION = "cell-1"


def test_a_viewer_receives_a_session_as_it_is_taught_and_the_end_of_the_command_harms_nothing(tmp_path):
    command = [sys.executable, "-c", "from caesura_clients.cli import main; main()", "foxglove"]
    with serving(tmp_path) as service, connect(service.endpoint) as caesura:
        options = ("--station", STATION, "--port", "0", "--connect", service.endpoint)
        with start([*command, *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            try:
                said = process.stdout.readline()
                port = int(re.fullmatch(rf"{STATION}: ws://127.0.0.1:(\d+); Ctrl-C ends it\n", said)[1])
                with viewing(port) as viewer, teaching(caesura, STATION) as taught:
                    taught.result(60.0)
                    eventually(lambda: any(one["complete"] for one in viewer.of("/program")))
                    eventually(lambda: viewer.count("/state") == RECORDING.t.size)
                    found = caesura.snapshot(STATION, SESSION)
                    newest = {one["t0"]: one["kind"] for one in viewer.of("/segments")}
                    for segment in found.segments.segments:
                        assert newest[segment.t0] == segment.kind
                    assert len(viewer.of("/program")[-1]["apps"]) == len(found.program.apps)
                    assert viewer.of("/wrench")[7]["force"] == RECORDING.signals["force"][7].tolist()
                process.send_signal(signal.SIGTERM)
                _, complaints = process.communicate(timeout=30.0)
            finally:
                process.kill()
        assert (process.returncode, complaints) == (0, "")
        with teaching(caesura, "cell-2") as taught:
            taught.result(60.0)


def foxglove(*arguments: str):
    return CliRunner().invoke(build(), ["foxglove", *arguments])


def test_the_layout_is_written_without_a_service(tmp_path):
    out = tmp_path / "layout.json"
    done = foxglove("--layout", str(out))
    assert (done.exit_code, done.stdout) == (0, f"{out}: in Foxglove, Layouts, Import from file\n")
    assert "StateTransitions!caesura" in json.loads(out.read_text())["configById"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--host", "0.0.0.0"), "--host 0.0.0.0: other machines reach it, and a viewer needs no password"),
        (("--station", "no such"), "'no such'"),
    ],
)
def test_what_cannot_be_served_is_one_line(arguments, words):
    done = foxglove(*arguments)
    assert (done.exit_code, done.stdout) == (1, "")
    (line,) = done.stderr.splitlines()
    assert words in line


def test_without_its_extra_it_names_it(monkeypatch):
    for name in [name for name in sys.modules if name.partition(".")[0] == "foxglove"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delitem(sys.modules, "caesura_clients.viewer.foxglove_server", raising=False)
    monkeypatch.setitem(sys.modules, "foxglove", None)
    done = foxglove("--station", STATION)
    assert done.stderr == (
        "error: caesura foxglove needs foxglove: pip install '.[foxglove]' in a clone of Caesura\n"
    )
