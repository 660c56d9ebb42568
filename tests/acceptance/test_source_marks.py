"""A mark that a source yields becomes a changepoint; recordings of other formats go over the wire."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from caesura_clients import Caesura, connect
from caesura_clients.bridge import Bridge
from caesura_clients.bridge.sources import Mark
from caesura_clients.bridge.sources.file import FileSource
from caesura_protocol.formats.mcap_write import McapContent, write_mcap
from caesura_service.offline_segmentation import segment_recording
from harness import ros
from harness.commands import application
from harness.processes import QUICK, RECORDING, SESSION, serving

PRESSED_S = 0.4  # in the middle of the rest at the beginning, where nobody sees a changepoint


@pytest.fixture(scope="module")
def caesura(tmp_path_factory) -> Iterator[Caesura]:
    with serving(tmp_path_factory.mktemp("journal")) as service, connect(service.endpoint) as client:
        yield client


class WithPedal(FileSource):
    """Plays a recording, and presses the pedal once."""

    def chunks(self):
        pressed = False
        for chunk in super().chunks():
            yield chunk
            if not pressed and chunk[-1, 0] >= 1.5:
                pressed = True
                yield Mark(PRESSED_S)


def test_a_pedal_forces_a_changepoint(caesura):
    undisturbed = segment_recording(RECORDING)
    assert all(abs(one.t - PRESSED_S) > 0.2 for one in undisturbed.changepoints)
    source = WithPedal(RECORDING, pace=6.0)
    with Bridge(caesura.transport, "cell-pedal", source, session=SESSION, settings=QUICK) as bridge:
        bridge.run()
    assert bridge.unmarked == []
    found = caesura.snapshot("cell-pedal", SESSION)
    (marked,) = [one for one in found.changepoints.changepoints if one.corrected]
    assert marked.t == pytest.approx(PRESSED_S, abs=0.1)
    assert (found.status.revision, found.program.author) == (1, "marker")
    assert found.status.samples == RECORDING.t.size


def as_mcap(path: Path) -> tuple[str, Path, tuple[str, ...]]:
    out = path / "x.mcap"
    write_mcap(out, McapContent("cell-1", "s1", "default", RECORDING, 1e9, RECORDING.columns))
    return "mcap", out, ()


def as_rosbag(path: Path) -> tuple[str, Path, tuple[str, ...]]:
    bag = ros.write_bag(path / "bag", ros.sensor_topics(RECORDING), "sqlite3")
    return "rosbag2", bag, ("--wrench-source", "flange_sensor")


@pytest.mark.parametrize("written", [as_mcap, as_rosbag])
def test_a_recording_of_another_format_is_played_to_the_service(caesura, tmp_path, written):
    source, file, more = written(tmp_path)
    where = ("--station", f"cell-{source}", "--session", SESSION, "--connect", caesura.transport.endpoint)
    options = ("--source", source, "--file", str(file), "--pace", "fast", *more)
    result = CliRunner().invoke(application(), ["bridge", *where, *options])
    assert result.exit_code == 0, result.output
    found = caesura.snapshot(f"cell-{source}", SESSION)
    expected = segment_recording(RECORDING)
    assert [one.kind for one in found.segments.segments] == [one.kind for one in expected.segments]
    if source == "mcap":
        assert found.segments.segments == expected.segments
