"""Recordings of every format, dropped from the desktop by the mouse, asked about and played as sessions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")
pytest.importorskip("rosbags", reason="rosbags is not installed (extra ros2)")

from playwright.sync_api import Page, expect

from caesura_clients.dashboard.recordings import UPLOADS
from caesura_protocol.formats.mcap_write import McapContent, write_mcap
from dashboard.browser import DESK, PATIENCE_MS, Visitor, needs_chromium
from dashboard.stage import Stage
from harness import ros
from harness.demonstrations import guided

pytestmark = needs_chromium
expect.set_options(timeout=PATIENCE_MS)
TAUGHT = guided()


@pytest.fixture
def visitor(opened: Visitor) -> Visitor:
    opened.begin_again(DESK)
    return opened


def npz(folder: Path) -> Path:
    TAUGHT.save(folder / "own.npz")
    return folder / "own.npz"


def csv(folder: Path) -> Path:
    """As Caesura writes it."""
    rows = [",".join(map(repr, row)) for row in TAUGHT.matrix().tolist()]
    (folder / "own.csv").write_text("\n".join([",".join(TAUGHT.columns), *rows]) + "\n", encoding="utf-8")
    return folder / "own.csv"


def mcap(folder: Path) -> Path:
    content = McapContent(
        station="cell-1",
        session="taught",
        preset="default",
        recording=TAUGHT,
        began_s=1.7e9,
        columns=TAUGHT.columns,
    )
    write_mcap(folder / "taught.mcap", content)
    return folder / "taught.mcap"


def bag(folder: Path) -> Path:
    """A folder with metadata and an MCAP of ROS 2, which states no wrench source."""
    return ros.write_bag(folder / "bag", ros.sensor_topics(TAUGHT), "mcap")


def sqlite_bag(folder: Path) -> Path:
    return ros.write_bag(folder / "bag3", ros.sensor_topics(TAUGHT), "sqlite3")


def drop(page: Page, path: Path) -> None:
    """Drag a file or a folder from the desktop into the zone, and let go, as a mouse does."""
    zone = page.locator(".drop")
    expect(zone).to_be_visible()
    box = zone.bounding_box()
    assert box is not None
    at = {"x": box["x"] + box["width"] / 2, "y": box["y"] + box["height"] / 2}
    data = {"items": [], "files": [str(path)], "dragOperationsMask": 1}
    devtools = page.context.new_cdp_session(page)
    for kind in ("dragEnter", "dragOver"):
        devtools.send("Input.dispatchDragEvent", {"type": kind, **at, "data": data})
    expect(zone, "the page shows that it takes what is above it").to_have_class("drop over")
    devtools.send("Input.dispatchDragEvent", {"type": "drop", **at, "data": data})


@pytest.mark.parametrize("write", [npz, csv, mcap, bag, sqlite_bag])
def test_what_is_dropped_is_asked_about_and_becomes_a_session(
    stage: Stage, visitor: Visitor, tmp_path: Path, write: Callable[[Path], Path]
):
    page, recording = visitor.page, write(tmp_path)
    name = recording.name.replace(".", "-")
    page.goto(f"{stage.dashboard.url}/recordings")
    drop(page, recording)
    form = page.locator(".questions")
    expect(form.locator("h2")).to_have_text(recording.name)
    expect(form.locator(".summary")).to_contain_text(f"{len(TAUGHT.t)} samples")
    for label, value in (("wrench-source", "flange_sensor"), ("hand", "yes"), ("robot", "panda")):
        form.locator(f".{label}").select_option(value)
    form.locator(".up").fill("z")
    form.locator(".station").fill("cell-files")
    form.locator(".session").fill(name)
    form.locator(".task").fill("press")
    visitor.picture(f"dropped-{name}")
    if name == "bag":  # which asks for the most
        assert visitor.barriers() == []
    form.locator(".play-recording").click()
    played_here = page.locator(
        ".plays li", has=page.get_by_role("link", name=f"cell-files/{name}", exact=True)
    )
    expect(played_here.locator(".play-state")).to_have_text("done")
    with stage.reader() as caesura:
        played = caesura.snapshot("cell-files", name)
        opened = played.status
        assert (opened.state, opened.samples, opened.description.task) == ("closed", len(TAUGHT.t), "press")
        assert opened.wrench.source == "flange_sensor"
        assert opened.wrench.hand_on_robot == "yes"
        assert (played.program.robot, played.program.up) == ("panda", (0.0, 0.0, 1.0))
        kinds = [one.kind for one in played.segments.segments]
        assert kinds[:3] == ["steady", "motion", "contact"]
        assert played.program.apps[0].kind == "move_to_contact"
    link = played_here.get_by_role("link")
    expect(link).to_have_attribute("href", f"/sessions/cell-files/{name}")
    link.click()
    expect(page.locator(".app").first).to_contain_text("move to contact")
    assert visitor.errors == []


def test_an_orientation_as_three_angles_is_a_part_of_the_form(stage: Stage, visitor: Visitor, tmp_path: Path):
    page = visitor.page
    page.goto(f"{stage.dashboard.url}/recordings")
    (tmp_path / "ur.csv").write_text(
        "time,x,y,z,rotvec_x,rotvec_y,rotvec_z\n0,1,2,3,3.1,0,0\n0.01,1,2,3,3.1,0,0\n"
    )
    drop(page, tmp_path / "ur.csv")
    part = page.get_by_role("group", name="orientation as axis times angle")
    expect(part.locator(".column-rx")).to_have_value("rotvec_x")
    expect(part.locator(".unit-rotation_vector")).to_have_value("rad")
    expect(page.locator(".column-roll")).to_have_count(0)
    page.locator(".more").click()
    expect(page.locator(".column-roll")).to_have_value("")
    visitor.picture("dropped-rotation-vector")
    assert visitor.errors == []


def test_two_files_at_once_are_refused_by_name(stage: Stage, visitor: Visitor, tmp_path: Path):
    page = visitor.page
    page.goto(f"{stage.dashboard.url}/recordings")
    folder = tmp_path / "two"
    folder.mkdir()
    npz(folder)
    csv(folder)
    drop(page, folder)
    expect(page.locator(".drop-state")).to_contain_text("expected one file")


def test_a_bad_file_leaves_the_form_of_the_one_before(stage: Stage, visitor: Visitor, tmp_path: Path):
    """It took the form away, with what was typed. Several bad files do not take the recording either."""
    page = visitor.page
    page.goto(f"{stage.dashboard.url}/recordings")
    drop(page, npz(tmp_path))
    form, state = page.locator(".questions"), page.locator(".drop-state")
    form.locator(".station").fill("cell-kept")
    form.locator(".session").fill("s1")
    np.savez(tmp_path / "odd.npz", a=np.zeros(3))
    expected = {"odd.npz": "has a; expected the times t, and pos (the flange's x"}
    for number in range(UPLOADS):  # which no process needs to read
        (tmp_path / f"odd-{number}.txt").write_text("1")
        expected[f"odd-{number}.txt"] = "expected one file"
    for name, words in expected.items():
        drop(page, tmp_path / name)
        expect(state).to_contain_text(f"{name}: {words}")
        expect(form.locator("h2")).to_have_text("own.npz")
        expect(form.locator(".station")).to_have_value("cell-kept")
    visitor.picture("dropped-odd")
    form.locator(".play-recording").click()
    played = page.locator(".plays li", has_text="cell-kept/s1")
    expect(played.locator(".play-state")).to_have_text("done")
    expect(played.get_by_role("link")).to_have_attribute("href", "/sessions/cell-kept/s1")
    drop(page, csv(tmp_path))
    expect(form.locator("h2")).to_have_text("own.csv")
    assert visitor.errors == []


def test_a_refused_play_links_to_no_session(stage: Stage, visitor: Visitor, tmp_path: Path):
    page = visitor.page
    page.goto(f"{stage.dashboard.url}/recordings")
    in_mm = replace(TAUGHT, signals={**TAUGHT.signals, "pos": 1000.0 * TAUGHT.signals["pos"]})
    in_mm.save(tmp_path / "mm.npz")
    drop(page, tmp_path / "mm.npz")
    form = page.locator(".questions")
    form.locator(".declared-length").select_option("")
    form.locator(".station").fill("cell-refused")
    form.locator(".play-recording").click()
    refused = page.locator(".plays li", has_text="cell-refused/")
    expect(refused.locator(".play-state.alarm")).to_be_visible()
    visitor.picture("dropped-refused")
    assert refused.get_by_role("link").count() == 0
