"""`caesura annotate` as an annotator has it: a real process, a real browser, a file on disk."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

from playwright.sync_api import Page, expect

from caesura_lab.ground_truth import read_annotation
from dashboard.browser import PATIENCE_MS, PHONE, TABLET, THEMES, Visitor, needs_chromium
from dashboard.stage import Pages
from harness.demonstrations import guided
from harness.processes import CAESURA, running

pytestmark = needs_chromium
expect.set_options(timeout=PATIENCE_MS)
DAY_S = 1_700_000_000.0  # when a recording with times of day begins
STEPS_TO_A_SECOND = 20  # of 0.05 s


class Annotate(Pages):
    """`caesura annotate FILE`."""

    def __init__(self, file: Path) -> None:
        super().__init__([*CAESURA, "annotate", str(file)])


@pytest.fixture
def visitor(opened: Visitor) -> Visitor:
    opened.begin_again(TABLET)
    return opened


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Annotate]:
    """One for tests that save nothing; each has a page, and so a cursor, of its own."""
    file = tmp_path_factory.mktemp("shared") / "guided.npz"
    guided().save(file)
    with running(Annotate(file)) as tool:
        yield tool


@pytest.fixture
def file(tmp_path: Path) -> Path:
    guided().save(tmp_path / "guided.npz")
    return tmp_path / "guided.npz"


@pytest.fixture
def annotation(file: Path) -> Path:
    """An annotation that is there already, with a key of which the page has no edit."""
    path = file.with_suffix(".ann.json")
    point = {"t": 0.5, "kind": "start", "tol": 0.15, "level": "major", "seen_by": "B"}
    path.write_text(
        json.dumps({"window": [0.0, 5.0], "changepoints": [point], "segments": [], "note": "kept"})
    )
    return path


def opened(tool: Annotate, visitor: Visitor) -> Page:
    visitor.page.goto(tool.url)
    visitor.page.locator("canvas").focus()
    return visitor.page


def press(page: Page, *keys: str) -> None:
    for key in keys:
        page.keyboard.press(key)


def test_a_recording_is_annotated_by_keys_alone_and_kept(file: Path, visitor: Visitor):
    visitor.watch_hosts()
    with running(Annotate(file)) as tool:
        page = opened(tool, visitor)
        expect(page.locator(".message")).to_have_text("nothing to save yet")
        press(page, *["ArrowRight"] * STEPS_TO_A_SECOND, "Shift+ArrowRight", "q", "+")
        press(page, *["ArrowRight"] * STEPS_TO_A_SECOND, "c", "o", "z", "v")
        expect(page.locator(".selection")).to_contain_text("2 changepoints, not saved")
        press(page, *["ArrowRight"] * STEPS_TO_A_SECOND, "d", "[", "2", "[", "1", "s")
        expect(page.locator(".message")).to_contain_text("saved")
        for visitor.theme, rules in THEMES.items():
            page.emulate_media(color_scheme=visitor.theme)
            visitor.picture("annotate")
            assert visitor.barriers(*rules) == [], visitor.theme
        assert visitor.hosts == {"127.0.0.1"}
        assert visitor.errors == []
    truth = read_annotation(file.with_suffix(".ann.json"))
    assert [(point.t, point.kind, point.optional) for point in truth.points] == [
        (1.005, "start", False),
        (2.005, "corner", False),
        (3.005, "optional", True),
    ]
    assert truth.points[0].tolerance_s == pytest.approx(0.2)
    assert [(span.t0, span.t1, span.kind) for span in truth.spans] == [
        (1.005, 2.005, "steady"),
        (2.005, truth.window[1], "motion"),
    ]


def test_a_legend_states_which_line_is_which(shared: Annotate, visitor: Visitor, tmp_path: Path):
    """The titles named x, y, z, and nothing stated which is which."""
    page = opened(shared, visitor)
    named = page.get_by_role("list", name="Legend").get_by_role("listitem")
    expect(named).to_have_text(["x", "y", "z", "magnitude of the force"])
    colours = named.locator("line").evaluate_all("lines => lines.map((one) => getComputedStyle(one).stroke)")
    assert len(set(colours[:3])) == 3
    t = np.arange(100) / 100.0
    np.savez(tmp_path / "joints.npz", t=t, q=np.tile(t[:, None], 7), robot="panda", wrench_source="none")
    with running(Annotate(tmp_path / "joints.npz")) as tool:
        named = opened(tool, visitor).get_by_role("list", name="Legend").get_by_role("listitem")
        expect(named).to_have_text(["q1, q4, q7", "q2, q5", "q3, q6"])
    assert visitor.errors == []


def test_what_was_not_saved_at_the_end_is_in_a_file(
    file: Path, visitor: Visitor, capfd: pytest.CaptureFixture[str]
):
    """Ctrl-C ended with the marks, and without a word."""
    with running(Annotate(file)) as tool:
        page = opened(tool, visitor)
        press(page, *["ArrowRight"] * STEPS_TO_A_SECOND, "q")
        expect(page.locator(".selection")).to_contain_text("1 changepoint, not saved")
        press(page, "Home", "2", "Shift+ArrowRight", "c", "2")
        expect(page.locator(".message")).to_contain_text(
            "motion from 0.00 to 1.00 s, over 1 major changepoint"
        )
        tool.end()
    draft = file.with_name("guided.ann.json.unsaved")
    assert f"not saved: the marks are in {draft}" in capfd.readouterr().err
    assert [point.t for point in read_annotation(draft).points] == [0.005, 1.0]
    with running(Annotate(file)):
        assert f"note: {draft} was not saved" in capfd.readouterr().err


def test_an_existing_annotation_is_continued(file: Path, annotation: Path, visitor: Visitor):
    with running(Annotate(file)) as tool:
        page = opened(tool, visitor)
        expect(page.locator(".selection")).to_contain_text("1 changepoint, saved")
        press(page, "]", "-", "s")
        expect(page.locator(".message")).to_contain_text("guided.ann.json")
        page.reload()
        expect(page.locator(".selection")).to_contain_text("± 0.10 s")
    content = json.loads(annotation.read_text(encoding="utf-8"))
    assert content["note"] == "kept"
    assert content["changepoints"] == [
        {"t": 0.5, "kind": "start", "tol": 0.1, "level": "major", "seen_by": "B"}
    ]


def test_keys_before_the_connection_stands_keep_their_order(file: Path, annotation: Path, visitor: Visitor):
    """A key that is pressed as the connection comes to stand was carried out before earlier ones."""
    with running(Annotate(file)) as tool:
        page = opened(tool, visitor)
        expect(page.locator(".selection")).to_contain_text("1 changepoint, saved")
        page.wait_for_function("window.did_handshake")
        page.evaluate(
            """() => {
              const canvas = document.querySelector("canvas");
              const press = (key) => canvas.dispatchEvent(new KeyboardEvent("keydown", { key }));
              window.did_handshake = false;
              press("]");
              press("-");
              window.did_handshake = true;
              press("s");
            }"""
        )
        expect(page.locator(".message")).to_contain_text("guided.ann.json")
    assert json.loads(annotation.read_text(encoding="utf-8"))["changepoints"][0]["tol"] == 0.1


def test_what_goes_to_a_changepoint_waits_for_the_one_that_is_being_made(
    file: Path, annotation: Path, visitor: Visitor
):
    """Keys that came before the answer to an edit went to the changepoints before it, or past one."""
    with running(Annotate(file)) as tool:
        page = opened(tool, visitor)
        expect(page.locator(".selection")).to_contain_text("1 changepoint, saved")
        press(page, *["ArrowRight"] * STEPS_TO_A_SECOND)
        page.evaluate(
            """() => {
              const canvas = document.querySelector("canvas");
              const keys = ["d", "ArrowRight", "[", "x", "]", "[", "ArrowLeft", "c"];
              for (const key of keys) canvas.dispatchEvent(new KeyboardEvent("keydown", { key }));
            }"""
        )
        expect(page.locator(".message")).to_have_text("corner at 0.450 s")
        expect(page.locator(".selection")).to_contain_text("2 changepoints, not saved")
        press(page, "s")
        expect(page.locator(".message")).to_contain_text("guided.ann.json")
    assert [point.t for point in read_annotation(annotation).points] == [0.45, 0.5]


def test_times_of_day_are_shown_from_the_start(tmp_path: Path, visitor: Visitor):
    """The cursor, the marks and the axis had ten digits before the point."""
    file = tmp_path / "day.npz"
    replace(guided(), t=guided().t + DAY_S).save(file)
    with running(Annotate(file)) as tool:
        page = opened(tool, visitor)
        press(page, *["ArrowRight"] * STEPS_TO_A_SECOND, "q")
        expect(page.locator(".message")).to_have_text("start at 1.000 s")
        expect(page.locator(".selection")).to_contain_text("Time 1.000 s")
        expect(page.locator(".selection")).to_contain_text("start at 1.000 s")
        start = "Times [s] from 2023-11-14 22:13:20 UTC on, the start;"
        assert visitor.page.locator("body").inner_text().count(start) == 1
        press(page, "s")
        expect(page.locator(".message")).to_contain_text("day.ann.json")
        assert visitor.errors == []
    assert [point.t for point in read_annotation(file.with_suffix(".ann.json")).points] == [DAY_S + 1.0]


def test_a_click_sets_the_cursor_and_a_button_does_what_its_key_does(shared: Annotate, visitor: Visitor):
    page = opened(shared, visitor)
    box = page.locator("canvas").bounding_box()
    assert box is not None
    page.locator("canvas").click(position={"x": box["width"] / 2, "y": 100})
    page.get_by_role("button", name="corner").click()
    said = page.locator(".selection")
    expect(said).to_contain_text(re.compile(r"nearest: corner at \d\.\d{3} s"))
    at = float(re.search(r"Time (\d\.\d{3})", said.inner_text()).group(1))  # type: ignore[union-attr]
    assert at == pytest.approx(guided().t[-1] / 2, rel=0.1)


def test_on_a_phone_the_buttons_are_apart_and_leave_room_for_the_plot(shared: Annotate, visitor: Visitor):
    """They touched each other, and filled half of the screen."""
    visitor.page.set_viewport_size(PHONE)
    page = opened(shared, visitor)
    boxes = page.locator(".tools button").evaluate_all(
        "(all) => all.map((one) => one.getBoundingClientRect()).map((box) => [box.left, box.right, box.top])"
    )
    assert all(left - right > 3 for (_, right, y), (left, _, top) in pairwise(boxes) if y == top)
    tools = page.locator(".tools").bounding_box()
    assert tools is not None
    assert tools["height"] < PHONE["height"] / 3
    assert visitor.sideways_px() <= 0


def test_a_key_counts_with_caps_lock_and_at_a_changepoint_means_the_segment_that_begins(
    file: Path, visitor: Visitor
):
    """Q W E R stand in the docs, and with the caps lock on, the page took none of them."""
    with running(Annotate(file)) as tool:
        page = opened(tool, visitor)
        press(page, *["ArrowRight"] * STEPS_TO_A_SECOND, "Q")
        expect(page.locator(".message")).to_have_text("start at 1.000 s")
        expect(page.locator(".selection")).to_contain_text("1 changepoint, not saved")
        press(page, "Home", "1", *["ArrowRight"] * STEPS_TO_A_SECOND, "2")
        expect(page.locator(".message")).to_contain_text("motion from 1.00 to")
        expect(page.locator(".selection")).to_contain_text("motion from 1.00 to")
        press(page, "End")
        expect(page.locator(".selection")).to_contain_text("motion from 1.00 to")


def test_an_edit_that_does_not_apply_says_why(shared: Annotate, visitor: Visitor):
    page = opened(shared, visitor)  # the cursor is at the start, where no other test puts a changepoint
    press(page, "x")
    expect(page.locator(".message.failed")).to_contain_text("no changepoint within")


def test_the_page_answers_no_other_host_name(shared: Annotate, visitor: Visitor):
    answer = visitor.page.request.get(shared.url, headers={"Host": "example.org"})
    assert answer.status == 403
