"""The panels that an operator switches on: torque, orientation, joints, gripper, and the buttons of time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

from playwright.sync_api import Locator, Page, expect
from scipy.spatial.transform import Rotation

from caesura_protocol.recording import Recording
from dashboard.browser import DESK, PATIENCE_MS, PHONE, Visitor, looks_right, needs_chromium, settled
from dashboard.operator import Operator
from dashboard.stage import Stage
from dashboard.test_whole_day import DRAWN, shown_range
from harness.demonstrations import guided

pytestmark = needs_chromium
expect.set_options(timeout=PATIENCE_MS)
T = 2.0  # [s] whose values are read
# A tool that is turned over shakes about the half turn: on a phone there are jumps in each pixel.
TURNED_OVER_S, TURNED_OVER_HZ, SHAKES_RAD = 120.0, 20.0, 5e-4
JOINTS = 6  # of a UR: its panels were left out, because a Panda has seven
PANELS = {
    "torque": ("torque", ("x", "y", "z"), 3),
    "orientation": ("rotation", ("x", "y", "z"), 1),
    "joints": ("q", tuple(f"q{i + 1}" for i in range(JOINTS)), 3),
    "joint torques": ("tau", tuple(f"tau{i + 1}" for i in range(JOINTS)), 2),
    "gripper": ("gripper", ("",), 1),
}
# As where a scroll bar takes room: the browser of the tests draws it upon the page.
SCROLLS = ".work:has(.u-wrap) { padding-right: 15px; }"
# The widths [px] of the band, and of each panel below it.
WIDTHS = """() => [".plots canvas.band", ".panels .u-wrap"].map((of) => [...document.querySelectorAll(of)])
  .map((found) => [...new Set(found.map((one) => one.getBoundingClientRect().width))])"""
# The times of the points of the first line around each of its breaks, and of the break.
BREAKS = """(name) => {
  const [times, values] = document.querySelector(".plots").plots.plots.get(name).plot.data;
  const at = (i, step) => { while (values[i] === undefined) i += step; return times[i]; };
  return [...times].flatMap((t, i) => (values[i] === null ? [[at(i - 1, -1), t, at(i + 1, 1)]] : []));
}"""
# Of the lines of a panel: their points, jumps, lines across a jump, and points that no stroke covers.
STROKES = """(name) => {
  const { plot } = document.querySelector(".plots").plots.plots.get(name), [times, ...lines] = plot.data;
  const found = { points: 0, jumps: 0, across: 0, bare: 0 };
  plot.ctx.save();
  plot.ctx.resetTransform();
  plot.ctx.setLineDash([]);
  Object.assign(plot.ctx, { lineWidth: 3 * devicePixelRatio, lineCap: "square" }); // also where a line ends
  lines.forEach((values, k) => {
    const covers = (t, value) => plot.ctx.isPointInStroke(
      plot.series[k + 1]._paths.stroke, plot.valToPos(t, "x", true), plot.valToPos(value, "y", true));
    const points = [...times].map((t, i) => [t, values[i]]).filter(([, value]) => Number.isFinite(value));
    points.forEach(([t, value], i) => {
      found.points += 1;
      if (!covers(t, value)) found.bare += 1;
      const [before, from] = points[i - 1] ?? [t, value];
      if (Math.abs(value - from) <= Math.PI) return;
      found.jumps += 1;
      if (covers((before + t) / 2, (from + value) / 2)) found.across += 1;
    });
  });
  plot.ctx.restore();
  return found;
}"""
# The inked values in the first and the last row of the labels, where they stand at both ends of a scale.
CUT = """async (name) => {
  const { plot } = document.querySelector(".plots").plots.plots.get(name), { canvas } = plot.ctx;
  const range = plot.scales.y.range;
  plot.scales.y.range = () => [-1, 1];
  plot.setScale("y", { min: -1, max: 1 });
  await new Promise(requestAnimationFrame);
  const inked = (y) => plot.ctx.getImageData(0, y, 50, 1).data.filter((one, i) => i % 4 === 3 && one).length;
  const found = [inked(0), inked(canvas.height - 1)];
  plot.scales.y.range = range;
  return found;
}"""
SHOWN = "() => [...document.querySelectorAll('.panels .panel')].map((one) => one.dataset.signal)"


def with_every_signal() -> Recording:
    """A demonstration with all that a robot may send; each column has a course of its own."""
    taught = guided()
    t = taught.t[:, None]
    half = 1.8 * np.sin(t[:, 0])  # beyond a half turn, and with another sign in each third sample
    quat = np.column_stack([np.sin(half), 0 * half, 0 * half, np.cos(half)])
    quat[::3] *= -1.0
    signals = {
        **taught.signals,
        "torque": 0.3 * np.sin(t + np.arange(3)),
        "quat": quat,
        "q": 0.5 * np.sin(0.4 * t + np.arange(JOINTS)),
        "tau": 2.0 * np.cos(0.7 * t + np.arange(JOINTS)),
        "gripper": 0.02 + 0.02 * np.sin(0.5 * t),
    }
    return replace(taught, signals=signals)


def drawn_signals() -> dict[str, np.ndarray]:
    """What the panels draw of `with_every_signal`, as it is sent; lengths and angles in SI units."""
    signals = with_every_signal().signals
    there = Rotation.from_quat(signals["quat"])
    return {**signals, "rotation": (there * there[0].inv()).as_rotvec()}


@pytest.fixture(scope="module")
def visitor(stage: Stage, opened: Visitor) -> Iterator[Visitor]:
    stage.teach("cell-1", with_every_signal(), session="over", pace="fast")
    stage.wait("cell-1")
    yield opened
    assert opened.errors == []


def opened(stage: Stage, visitor: Visitor) -> Page:
    visitor.begin_again(DESK)
    visitor.page.goto(f"{stage.dashboard.url}/sessions/cell-1/over")
    settled(visitor.page)
    return visitor.page


def switch(page: Page, name: str) -> None:
    page.get_by_role("group", name="Signals").get_by_role("button", name=name, exact=True).press("Enter")


def panel_of(page: Page, name: str) -> Locator:
    return page.locator(f".panel[data-signal='{name}']")


def test_panels_are_as_wide_as_the_band_where_the_page_scrolls(stage: Stage, visitor: Visitor):
    """Without panels the page was wider. A boundary stood up to 15 px beside the one in the band."""
    page = opened(stage, visitor)
    page.add_style_tag(content=SCROLLS)
    switch(page, "torque")
    expect(panel_of(page, "torque")).to_be_visible()
    band, panels = page.evaluate(WIDTHS)
    assert len(band) == 1
    assert panels == band


def test_no_label_of_a_scale_is_cut(stage: Stage, visitor: Visitor):
    """The uppermost one lacked its first row of pixels where it stood at the end of the scale."""
    page = opened(stage, visitor)
    assert page.evaluate(CUT, "position") == [0, 0]


def test_panels_that_are_switched_on_draw_what_was_sent_and_read_it(stage: Stage, visitor: Visitor):
    page, sent, signals = opened(stage, visitor), with_every_signal(), drawn_signals()
    for name in PANELS:
        if name not in page.evaluate(SHOWN):
            switch(page, name)
        expect(panel_of(page, name)).to_be_visible()
    settled(page)
    for name, (signal, lines, _) in PANELS.items():
        found = page.evaluate(DRAWN, [name, *shown_range(page)])
        assert found["off"] == [0] * len(lines), "nothing is taken off"
        assert len(found["points"]) == len(lines)
        for k, points in enumerate(found["points"]):
            samples = dict(zip(sent.t.tolist(), signals[signal][:, k].tolist(), strict=True))
            rounding = 1e-9 if signal == "rotation" else 0.0
            assert len(points) > 100
            assert all(abs(samples[t] - value) <= rounding for t, value in points), f"{name} {lines[k]}"
    jumps = np.flatnonzero(np.abs(np.diff(signals["rotation"][:, 0])) > np.pi)
    breaks = page.evaluate(BREAKS, "orientation")
    assert len(jumps) == len(breaks) > 0
    for jump, (before, at, after) in zip(jumps, breaks, strict=True):
        assert (before, after) == (sent.t[jump], sent.t[jump + 1]), "no line from one end to the other"
        assert before < at < after
    strokes = page.evaluate(STROKES, "orientation")
    assert strokes["jumps"] == len(jumps)
    assert (strokes["across"], strokes["bare"]) == (0, 0)

    x, _ = Operator.at(page, visitor).place(T)
    box = page.locator(".panels .u-over").first.bounding_box()
    assert box is not None
    page.mouse.move(x, box["y"] + box["height"] / 2)
    near = np.abs(sent.t - T) < 0.03
    expect(panel_of(page, "orientation").locator("strong")).to_have_text("orientation from the start [°]")
    for name, (signal, lines, digits) in PANELS.items():
        values = [float(words) for words in panel_of(page, name).locator("output").all_inner_texts()]
        scale = {"gripper": 1000.0, "orientation": 180.0 / np.pi}.get(name, 1.0)
        assert len(values) == len(lines)
        for k, value in enumerate(values):
            off = np.min(np.abs(scale * signals[signal][near, k] - value))
            assert off <= 0.51 * 10.0**-digits, f"{name} {lines[k]}"
        titles = panel_of(page, name).locator(".value").all_inner_texts()
        assert all(words.startswith(line) for words, line in zip(titles, lines, strict=True))


def test_no_line_is_drawn_across_a_half_turn_where_jumps_crowd(stage: Stage, visitor: Visitor):
    """The plot of a tool that was turned over was a wall, and a view of minutes had lines across, too."""
    t = np.arange(0.0, TURNED_OVER_S, 1.0 / TURNED_OVER_HZ)
    rng = np.random.default_rng(0)
    half = np.minimum(0.5, 0.05 * t) * np.pi + SHAKES_RAD * rng.standard_normal(t.size)
    turned = Recording(
        t=t,
        signals={
            "pos": [0.4, 0.0, 0.3] + 1e-4 * rng.standard_normal((t.size, 3)),
            "quat": np.column_stack([0.0 * t, 0.0 * t, np.sin(half), np.cos(half)]),
        },
        wrench_source="none",
        name="turned over",
    )
    stage.teach("turned-over", turned, session="over", pace="fast")
    stage.wait("turned-over")
    visitor.begin_again(PHONE)
    page = visitor.page
    page.goto(f"{stage.dashboard.url}/sessions/turned-over/over")
    settled(page)
    switch(page, "orientation")
    panel_of(page, "orientation").scroll_into_view_if_needed()
    settled(page)
    visitor.picture("turned-over")
    strokes = page.evaluate(STROKES, "orientation")
    assert strokes["jumps"] > 100
    assert (strokes["across"], strokes["bare"]) == (0, 0)


@pytest.mark.parametrize(
    ("values", "title", "read"),
    [
        ((0.04, 0.04), "gripper [mm]", "40.0"),
        ((0.0, 1.0), "gripper [1 closed]", "0"),
        ((0.0, 0.0), "gripper [mm, or 1 closed]", "0.0"),
    ],
    ids=["opening", "flag", "only zeros"],
)
def test_the_opening_of_a_gripper_is_in_millimetres_and_a_flag_is_not(
    stage: Stage, visitor: Visitor, values: tuple[float, float], title: str, read: str
):
    taught = guided()
    before, after = values
    fingers = np.where(taught.t < 2 * T, before, after)[:, None]
    station = f"fingers-{before:g}-{after:g}".replace(".", "-")
    stage.teach(
        station, replace(taught, signals={**taught.signals, "gripper": fingers}), session="over", pace="fast"
    )
    stage.wait(station)
    visitor.begin_again(DESK)
    page = visitor.page
    page.goto(f"{stage.dashboard.url}/sessions/{station}/over")
    settled(page)
    switch(page, "gripper")
    panel = panel_of(page, "gripper")
    expect(panel.locator("strong")).to_have_text(title)
    settled(page)
    page.mouse.move(*Operator.at(page, visitor).place(T))
    expect(panel.locator("output")).to_have_text(read)


def test_the_choice_of_panels_stays_with_the_browser_and_fits_a_phone(stage: Stage, visitor: Visitor):
    page = opened(stage, visitor)
    assert page.evaluate(SHOWN) == ["position", "speed", "force", "joints"]
    for name in ("position", "speed", "torque", "orientation", "gripper", "joint torques"):
        switch(page, name)
    shown = ["force", "torque", "orientation", "joints", "joint torques", "gripper"]
    assert page.evaluate(SHOWN) == shown
    page.reload()
    settled(page)
    assert page.evaluate(SHOWN) == shown
    looks_right(visitor, "panels", within=".panels")


def test_earlier_and_later_move_the_view_by_half_and_not_out_of_the_session(stage: Stage, visitor: Visitor):
    page = opened(stage, visitor)
    begin, end = shown_range(page)
    moves = page.get_by_role("group", name="Range of time")
    earlier, later = (moves.get_by_role("button", name=name, exact=True) for name in ("Earlier", "Later"))
    for _ in range(2):
        moves.get_by_role("button", name="Zoom in").press("Enter")
    settled(page)
    start, until = shown_range(page)
    assert until - start == pytest.approx((end - begin) / 4)
    half = (until - start) / 2
    for button, by in ((later, half), (earlier, 0.0), (earlier, -half)):
        button.press("Enter")
        settled(page)
        assert shown_range(page) == (pytest.approx(start + by), pytest.approx(until + by))
    for button, at in ((earlier, begin), (later, end - 2 * half)):
        for _ in range(9):
            button.press("Enter")
        settled(page)
        assert shown_range(page)[0] == pytest.approx(at)
