"""The band of kinds and phases: names that have room, and the name of what a pointer rests upon."""

from __future__ import annotations

from itertools import pairwise

import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

from playwright.sync_api import Page, expect

from dashboard.browser import DESK, PATIENCE_MS, PHONE, Visitor, needs_chromium, settled
from dashboard.operator import Operator
from dashboard.stage import Stage
from harness.demonstrations import taught

pytestmark = needs_chromium
expect.set_options(timeout=PATIENCE_MS)
LONG_S, ZOOMS = 60.0, 3
# What is written into the band at its next drawing: words, and where they begin and end [px].
WRITTEN = """() => new Promise((drawn) => {
  const { prototype } = CanvasRenderingContext2D, { fillText } = prototype, found = [];
  prototype.fillText = function (words, x, y, ...rest) {
    const { width } = this.measureText(words);
    const isName = this.canvas.className === "band" && this.textAlign === "center";
    if (isName) found.push([words, y, x - width / 2, x + width / 2]);
    return fillText.call(this, words, x, y, ...rest);
  };
  document.querySelector(".plots").plots.state.redraw();
  requestAnimationFrame(() => setTimeout(() => {
    prototype.fillText = fillText;
    drawn(found);
  }));
})"""
# The segments with the pixels that they have in the band.
SEGMENTS = """() => {
  const { state } = document.querySelector(".plots").plots, scale = state.scale();
  return state.segments.map(([t0, tn, kind]) => [kind, scale.x(t0), scale.x(tn), (t0 + tn) / 2, t0, tn]);
}"""


def opened_at(stage: Stage, visitor: Visitor, size: dict[str, int]) -> Page:
    visitor.begin_again(size)
    page = visitor.page
    page.goto(f"{stage.dashboard.url}/sessions/cell-1/many")
    expect(page.locator(".app").first).to_be_visible()
    settled(page)
    return page


@pytest.fixture(scope="module", autouse=True)
def many(stage: Stage) -> None:
    """A session of a minute with dozens of segments."""
    stage.teach("cell-1", taught(3, LONG_S), session="many", pace="fast")
    stage.wait("cell-1")


@pytest.mark.parametrize("size", [DESK, PHONE], ids=["desk", "phone"])
def test_names_in_the_band_stand_within_their_segments(stage: Stage, opened: Visitor, size: dict[str, int]):
    page = opened_at(stage, opened, size)
    for _ in range(ZOOMS):
        segments, written = page.evaluate(SEGMENTS), page.evaluate(WRITTEN)
        for row in {y for _, y, *_ in written}:
            ends = sorted((left, right) for _, y, left, right in written if y == row)
            assert all(one[1] < other[0] for one, other in pairwise(ends)), "a name lies upon another one"
        kinds = max((y for _, y, *_ in written), default=0)
        cut = [
            words
            for words, y, left, right in written
            if y == kinds and not any(start <= left and right <= end for _, start, end, *_ in segments)
        ]
        assert cut == []
        page.get_by_role("button", name="Zoom in").press("Enter")
        settled(page)
    assert written, "a segment has room for its name"
    assert opened.errors == []


def test_a_pointer_reads_the_name_of_a_segment_without_room_for_it(stage: Stage, opened: Visitor):
    """A narrow segment had a colour and no name."""
    page = opened_at(stage, opened, PHONE)
    named = {words for words, *_ in page.evaluate(WRITTEN)}
    narrow = min(page.evaluate(SEGMENTS), key=lambda one: one[2] - one[1])
    kind, left, right, t, t0, tn = narrow
    assert right - left < 20, f"it has no room for a name: {named}"
    x, _ = Operator.at(page, opened).place(t)
    band = page.locator("canvas.band").bounding_box()
    assert band is not None
    tip = page.locator(".band-tip")
    page.mouse.move(x, band["y"] + 40)
    expect(tip).to_contain_text(f"{kind} ")
    expect(tip).to_contain_text(f"{t0:.2f} to {tn:.2f} s")
    page.mouse.move(x, band["y"] + 12)
    expect(tip).to_contain_text("phase ")
    box = tip.bounding_box()
    assert box is not None
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= PHONE["width"]
    page.mouse.move(x, band["y"] + 120)
    expect(tip).to_have_count(0)
    assert opened.errors == []
