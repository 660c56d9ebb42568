"""An operator who corrects a session at the dashboard, by mouse, finger and keyboard."""

from __future__ import annotations

from contextlib import suppress

from playwright.sync_api import Locator, Page, expect

from caesura_clients import Caesura
from caesura_protocol.errors import ProtocolError
from dashboard.browser import LOOK_MS, Visitor, settled
from dashboard.stage import KINDS, Stage
from dashboard.subscriber import Subscriber

T = 1.4  # [s] in the middle of the first movement, where no changepoint is
SHOWN_S = 5.0  # up to there the plot shows what is found while the operator points into it
# Where a time is on the screen. Beside the scale are 64 and 12 px, as in scale.js, and a border of 1 px.
PLACE = """(t) => {
  const plots = document.querySelector(".plots"), { from, to } = plots.dataset;
  document.querySelector("canvas.band").scrollIntoViewIfNeeded(); // not below a message
  const { left, top, width, height } = plots.getBoundingClientRect();
  return [left + 65 + (width - 78) * (t - from) / (to - from), top + height / 2];
}"""
NEAR_S = 0.06  # half a cell of the segmentation's grid, and a pixel


class Operator:
    """An operator at the dashboard, whose station is being taught, and the wire beside it."""

    def __init__(self, stage: Stage, visitor: Visitor, wire: Subscriber, station: str) -> None:
        self.visitor, self.wire = visitor, wire
        self.page: Page = visitor.page
        self.page.goto(f"{stage.dashboard.url}/station/{station}")

    @classmethod
    def at(cls, page: Page, visitor: Visitor) -> Operator:
        """An operator at a page that is open already and has its samples, without the wire."""
        operator = cls.__new__(cls)
        operator.page, operator.visitor = page, visitor
        settled(page)
        return operator

    def wait_for_three_segments(self) -> None:
        """On the screen, of the right kinds and final."""
        table = self.page.locator("details.table")
        table.locator("summary").click()
        rows = table.locator("tbody tr")
        for index, kind in enumerate(KINDS):
            expect(rows.nth(-1 - index)).to_contain_text(kind)
            expect(rows.nth(-1 - index)).to_contain_text("final")

    def look_at_the_beginning(self) -> None:
        """What is shown stands still: from 0 to 5 to 10 s, found up to SHOWN_S."""
        self.is_called("Ann")
        # By key: within half a second, a click at the place of the one before counts as a double click.
        self.page.get_by_role("button", name="Live", exact=True).press("Enter")
        slider = self.page.get_by_role("slider", name="Show until")
        reaches = f"(slider) => slider.max >= {SHOWN_S}"
        self.page.wait_for_function(reaches, arg=slider.element_handle(), polling=LOOK_MS)
        live = "(plot) => { const { from, to } = plot.dataset; return to - from > 29.9 ? to - from : 0; }"
        span_s = self.page.wait_for_function(
            live, arg=self.plot.element_handle(), polling=LOOK_MS
        ).json_value()
        while span_s > 2.0 * SHOWN_S:  # more than 30 s where a test before this one showed everything
            self.page.get_by_role("button", name="Zoom in").click()
            span_s /= 2.0
        slider.fill(str(SHOWN_S))
        stands_still = f"(plot) => Math.abs(plot.dataset.to - {span_s}) < 1e-5"
        self.page.wait_for_function(stands_still, arg=self.plot.element_handle(), polling=LOOK_MS)

    @property
    def plot(self) -> Locator:
        return self.page.locator(".plots")

    def place(self, t: float) -> tuple[float, float]:
        """Where a time is on the screen: in the middle of the plots, which are in sight."""
        x, y = self.page.evaluate(PLACE, t)
        return x, y

    def is_called(self, name: str) -> None:
        """As the browser has kept it, or without a name."""
        self.page.evaluate(
            """(name) => {
              localStorage.setItem("caesura-author", name);
              window.dispatchEvent(new CustomEvent("caesura-author", { detail: name }));
            }""",
            name,
        )

    def click(self, t: float) -> None:
        self.page.mouse.click(*self.place(t))

    def touch_for_long(self, t: float) -> None:
        """With a finger, until the menu is there."""
        x, y = self.place(t)
        devtools = self.page.context.new_cdp_session(self.page)
        devtools.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [{"x": x, "y": y}]})
        self.page.locator(".correct-menu").wait_for()
        devtools.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})

    def insert(self, t: float) -> None:
        """By the menu of that time."""
        self.page.mouse.click(*self.place(t), button="right")
        self.page.locator(".correct-menu .insert").click()

    def drag(self, t: float, to: float) -> None:
        self.page.mouse.move(*self.place(t))
        self.page.mouse.down()
        self.page.mouse.move(*self.place((t + to) / 2))
        self.page.mouse.move(*self.place(to))
        self.page.mouse.up()

    def press(self, name: str) -> None:
        self.page.get_by_role("button", name=name, exact=True).click()

    def is_shown(self, words: str) -> None:
        expect(self.page.locator(".message")).to_contain_text(words)

    def version(self) -> int:
        return int(self.page.locator(".version").inner_text())

    def undo_everything(self, caesura: Caesura) -> None:
        """Until the page has nothing to undo either."""
        self.is_called("Ann")
        with suppress(ProtocolError):  # the last one is refused
            while True:
                caesura.undo(self.wire.now.station, self.wire.now.session, author="Ann")
        expect(self.page.get_by_role("button", name="Undo", exact=True)).to_have_count(0)
