"""Draw the pictures of docs/dashboard.md: a demonstration that goes on, and one that has ended and is named.

Usage: python tests/bench/dashboard_pictures.py [--to docs]
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import Browser, Page, expect

sys.path.insert(0, str(Path(__file__).parents[1]))

from dashboard.browser import DESK, PATIENCE_MS, Visitor, chromium, settled
from dashboard.stage import Stage, StandbyBridge, staged
from harness.demonstrations import taught

TAUGHT_S, AGE_S = 240.0, 62.0  # [s] of the recording; how old its session is at once
NAMED_AFTER_S = 6.5  # [s] the hand has gone back and rests
# What goes on is never at rest: the newest half minute is there.
HAS_SAMPLES = """() => {
  const { data } = document.querySelector(".plots").plots.state;
  return data && data.to - data.from > 25;
}"""


def taught_now(stage: Stage, page: Page, to: Path) -> None:
    """A demonstration that goes on."""
    with stage.aged("cell-2", taught(7, TAUGHT_S), AGE_S):
        page.goto(f"{stage.dashboard.url}/station/cell-2")
        expect(page.locator(".desk-state")).to_contain_text("Teaching 6")
        expect(page.locator(".app").first).to_be_visible()
        page.wait_for_function(HAS_SAMPLES)
        expect(page.locator(".hint"), "those of the minute that was sent at once are over").to_have_count(0)
        page.screenshot(path=to / "dashboard_station.png")


def named(stage: Stage, page: Page, to: Path) -> None:
    """A demonstration by a bridge in standby, which has ended and is named."""
    bridge = StandbyBridge(stage)
    try:
        bridge.start()
        page.goto(f"{stage.dashboard.url}/station/cell-1")
        desk, form = page.locator(".desk"), page.locator(".description")
        expect(desk).to_contain_text("Ready")
        desk.locator(".operator").fill("Ann")
        desk.locator(".task").fill("wipe the table")
        desk.locator(".task").press("Enter")
        until = page.locator(".scrub output")
        page.wait_for_function(
            f"(shown) => parseFloat(shown.innerText) > {NAMED_AFTER_S}", arg=until.element_handle()
        )
        desk.get_by_role("button", name="Stop").click()
        expect(desk).to_contain_text("Ready")
        form.locator("summary").click()
        form.locator(".yes").click()
        form.locator(".name-tags").fill("left, slow")
        form.locator(".name-note").fill("calm hand")
        form.locator(".name-note").press("Tab")
        expect(form.locator("summary")).to_contain_text("calm hand")
        expect(page.locator("#program-title")).to_contain_text("complete")
        settled(page)
        page.screenshot(path=to / "dashboard_start.png")
    finally:
        bridge.kill()


def main() -> None:
    """Teach, name, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--to", type=Path, default=Path(__file__).parents[2] / "docs")
    to: Path = parser.parse_args().to
    with tempfile.TemporaryDirectory() as folder, staged(Path(folder)) as stage, chromium() as browser:
        drawn(stage, browser, to)


def drawn(stage: Stage, browser: Browser, to: Path) -> None:
    """Draw each picture with a browser that was never there."""
    expect.set_options(timeout=PATIENCE_MS)
    for draw in (taught_now, named):
        visitor = Visitor(browser, viewport=DESK)
        draw(stage, visitor.page, to)
        assert visitor.errors == []
        visitor.close()


if __name__ == "__main__":
    main()
