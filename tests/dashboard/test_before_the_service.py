"""A dashboard that is started before the service: its pages say so, and show the stations once it runs."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

from playwright.sync_api import expect

from dashboard.browser import DESK, PATIENCE_MS, Visitor, looks_right, needs_chromium
from dashboard.stage import Bridges, Dashboard
from harness.demonstrations import guided
from harness.processes import ServiceProcess, running

pytestmark = needs_chromium
expect.set_options(timeout=PATIENCE_MS)


def test_a_dashboard_before_its_service_names_what_to_start_and_connects_by_itself(
    opened: Visitor, tmp_path: Path
):
    """It did not listen before the service ran."""
    opened.begin_again(DESK)
    page, service = opened.page, ServiceProcess(tmp_path / "journal")
    with running(Dashboard(service.endpoint)) as dashboard:
        page.goto(dashboard.url)
        banner = page.get_by_role("alert")
        expect(banner).to_contain_text(f"no router at {service.endpoint}; is the service running?")
        expect(banner).to_contain_text("Start it with 'caesura serve'")
        expect(page.locator(".summary")).to_have_text("0 stations, no service answers")
        expect(page.locator(".empty")).to_contain_text("No service answers. Start one with caesura serve")
        looks_right(opened, "before-the-service")
        page.goto(f"{dashboard.url}/station/cell-1")
        expect(page.locator(".desk-why")).to_contain_text("no router at")
        expect(page.locator(".program .empty")).to_have_text(
            "The service does not answer: what was taught is not known."
        )
        page.goto(f"{dashboard.url}/sessions")
        expect(page.locator(".empty")).to_have_text(
            "The service does not answer: which sessions it has is not known."
        )
        expect(page.locator(".summary"), "it was 0 sessions").to_have_text("")
        page.goto(dashboard.url)
        expect(banner).to_contain_text("no router at")
        with running(service), closing(Bridges(service, tmp_path)) as bridges:
            expect(banner).to_be_hidden()
            expect(page.locator(".summary")).to_have_text("0 stations, none in trouble")
            bridges.teach("cell-1", guided(), pace="fast")
            expect(page.get_by_role("link", name="cell-1")).to_be_visible()
            page.goto(f"{dashboard.url}/station/cell-2")
            expect(page.locator(".program .empty")).to_have_text("Nothing taught yet.")
            assert opened.errors == []
