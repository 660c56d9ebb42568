"""`caesura record` beside a real service: the file holds what the service got and what it said."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from jsonschema import Draft202012Validator
from mcap.reader import make_reader
from typer.testing import CliRunner

from caesura_clients import Caesura, connect
from caesura_clients.bridge import Bridge
from caesura_protocol.formats.read import load_recording
from caesura_service.offline_segmentation import segment_recording
from clients.examples import LiveSource, samples
from harness.commands import application
from harness.processes import QUICK, RECORDING, SESSION, reaches, serving, started, teaching


@pytest.fixture(scope="module")
def caesura(tmp_path_factory) -> Iterator[Caesura]:
    with serving(tmp_path_factory.mktemp("journal")) as service, connect(service.endpoint) as client:
        yield client


@contextmanager
def recording(caesura: Caesura, station: str, out: Path) -> Iterator[subprocess.Popen]:
    """`caesura record`, once it listens."""
    command = [sys.executable, "-c", "from caesura_clients.cli import main; main()", "record"]
    options = ("--station", station, "-o", str(out), "--connect", caesura.transport.endpoint)
    with started([*command, *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert "waiting for" in process.stderr.readline()
        yield process


def test_a_recorded_demonstration_is_not_replaced(tmp_path):
    out = tmp_path / "live.npz"
    out.write_bytes(b"taught before")
    done = CliRunner().invoke(application(), ["record", "--station", "cell-1", "-o", str(out)])
    why = f"error: cannot write {out}: it exists; name another file, or move it away\n"
    assert (done.exit_code, done.stderr) == (1, why)
    assert out.read_bytes() == b"taught before"


@pytest.mark.parametrize("suffix", ["mcap", "npz"])
def test_a_session_is_recorded_as_it_was_taught(caesura, tmp_path, suffix):
    out, station = tmp_path / f"live.{suffix}", f"cell-{suffix}"
    with recording(caesura, station, out) as process, teaching(caesura, station) as taught:
        taught.result(60.0)
        said, complaints = process.communicate(timeout=60.0)  # it ends with the session
    assert (process.returncode, complaints) == (0, f"recording {station}/{SESSION}\n")
    assert said == f"{out}: {station}/{SESSION}, {RECORDING.t.size} samples, {RECORDING.t[-1]:.2f} s\n"
    found = load_recording(out)
    np.testing.assert_allclose(found.t, RECORDING.t, atol=1e-12)
    for name, values in RECORDING.signals.items():
        assert np.array_equal(found.signals[name], values)
    assert found.wrench_source == RECORDING.wrench_source
    reported = caesura.snapshot(station, SESSION)
    assert segment_recording(found).segments == reported.segments.segments
    if suffix == "mcap":
        counts: Counter[str] = Counter()
        with out.open("rb") as stream:
            for schema, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
                Draft202012Validator(json.loads(schema.data)).validate(json.loads(message.data))
                counts[channel.topic] += 1
        assert counts["/state"] == counts["/wrench"] == RECORDING.t.size
        assert counts["/segments"] == len(reported.segments.segments)
        assert counts["/changepoints"] == len(reported.changepoints.changepoints)
        assert counts["/program"] == counts["/path"] == 1


def test_interrupted_it_writes_what_came_and_says_that_the_session_goes_on(caesura, tmp_path):
    out = tmp_path / "part.npz"
    with Bridge(caesura.transport, "cell-late", LiveSource(), session=SESSION, settings=QUICK) as bridge:
        bridge.wait_open(30.0)
        bridge.send(samples(1000))
        with recording(caesura, "cell-late", out) as process:
            assert "cell-late" in process.stderr.readline()  # its heartbeats go on
            bridge.send(samples(500, t0=1.0))
            reaches(caesura, "cell-late", 1500)
            process.send_signal(signal.SIGINT)
            _, complaints = process.communicate(timeout=60.0)
        assert process.returncode == 0, complaints
        bridge.finish()
    assert "the session goes on" in complaints
    found = load_recording(out)
    assert found.t[0] == 0.0  # what came before was asked of the bridge's ring
    assert 1000 <= found.t.size <= 1500
