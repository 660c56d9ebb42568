"""The recordings in data/ against what really happened, and the wire against the file."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from caesura_clients import connect
from caesura_clients.bridge.sources.file import FileSource
from caesura_protocol.formats.read import load_recording
from caesura_protocol.messages import Segment
from caesura_service.app import Service
from caesura_service.config import ServiceConfig
from harness.segmentations import segmented

ROOT = Path(__file__).parents[2]
REAL = ROOT.parent / "shared" / "data" / "real"
TOLERANCE_S = 0.3


def truth(name: str) -> dict:
    return json.loads((ROOT / "data" / f"{name}.ann.json").read_text())


def in_order(wanted: list[str], found: list[str]) -> bool:
    rest = iter(found)
    return all(kind in rest for kind in wanted)


@pytest.mark.parametrize("preset", ["default", "integrated"])
def test_pick_and_place_is_moved_touched_carried_placed_and_left(preset: str):
    view = segmented(load_recording(ROOT / "data" / "pick_and_place.npz"), preset)
    kinds = [one.kind for one in view.segments]
    assert in_order(["motion", "contact", "transport", "contact", "motion"], kinds)
    assert in_order(
        ["move_to_contact", "grasp", "transport", "gripper_move", "cartesian_motion"],
        [app.kind for app in view.apps],
    )
    for app in view.apps:
        if app.kind == "transport":
            assert app.load_kg == pytest.approx(0.25, abs=0.06)


@pytest.mark.parametrize(
    ("name", "preset"),
    [
        ("pick_and_place", "default"),
        ("pick_and_place", "integrated"),
        ("button", "default"),
        ("button", "integrated"),
        ("dispenser", "integrated"),
    ],
)
def test_contacts_begin_and_end_when_they_did(name: str, preset: str):
    view = segmented(load_recording(ROOT / "data" / f"{name}.npz"), preset)
    times = [one.t for one in view.changepoints]
    for point in truth(name)["changepoints"]:
        if point["kind"] in {"contact_on", "contact_off"}:
            assert min(abs(t - point["t"]) for t in times) <= TOLERANCE_S, point


@pytest.mark.parametrize(
    "path",
    [ROOT / "data" / "pick_and_place.npz", REAL / "modena_panda_0.npz"],
    ids=["simulated", "real"],
)
def test_the_wire_and_the_file_give_the_same_numbers(path: Path):
    if not path.exists():
        pytest.skip(f"{path} is not here; real recordings are not part of the repository")
    recording = load_recording(path)
    view = segmented(recording)
    with Service(ServiceConfig(listen="tcp/127.0.0.1:0")) as service, connect(service.endpoint) as caesura:
        with caesura.bridge("cell-1", FileSource(recording, pace=math.inf)) as bridge:
            bridge.run()
        snapshot = caesura.snapshot("cell-1")
        program = caesura.program("cell-1")
    segments: tuple[Segment, ...] = snapshot.segments.segments
    assert segments == view.segments
    assert snapshot.changepoints.changepoints == view.changepoints
    assert program.apps == view.apps
    assert snapshot.status.samples == recording.t.size
