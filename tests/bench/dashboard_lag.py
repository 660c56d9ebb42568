"""Does the dashboard keep up? Stations are taught in real time; a browser has all and one of them open.

Service, dashboard, bridges and browser are processes of their own on this machine. Every tenth of a second
what a page shows is compared with what a subscriber has heard: how much session time it is behind the wire.
The time to load is from the request until a card, the signals or a table can be seen; median of seven.
Usage: python tests/bench/dashboard_lag.py
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
from playwright.sync_api import Browser, Page

sys.path.insert(0, str(Path(__file__).parents[1]))

from caesura_clients.dashboard.station_summary import reached
from dashboard.browser import Visitor, chromium
from dashboard.stage import Stage, staged
from dashboard.subscriber import Subscriber
from harness.demonstrations import taught
from harness.processes import eventually

LOOK_S = 0.1
LOADS = 7
# When each card's time changed, in the page itself.
COUNT = """() => {
  window.changes = {};
  const count = (name) => { window.changes[name] = (window.changes[name] || 0) + 1; };
  const watch = (found) => found.forEach((one) => {
    const card = one.target.closest("li.card");
    if (card && one.target.innerText.endsWith(" s")) count(card.querySelector("h2").innerText);
  });
  new MutationObserver(watch).observe(document.querySelector("ul.cards"), { childList: true, subtree: true });
}"""
SHOWN = """() => [...document.querySelectorAll("li.card")].map((card) => {
  const time = [...card.querySelectorAll("dl div")].find((one) => one.innerText.startsWith("time"));
  return [card.querySelector("h2").innerText, parseFloat(time.children[1].innerText)];
})"""


def load(browser: Browser, url: str, seen: str) -> str:
    """[s] until it can be seen, with an empty cache each time."""
    took = []
    for _ in range(LOADS):
        visitor, began = Visitor(browser), time.monotonic()
        visitor.page.goto(url, wait_until="commit")
        visitor.page.locator(seen).first.wait_for()
        took.append(time.monotonic() - began)
        visitor.close()
    return f"{np.median(took):.2f} (worst {max(took):.2f})"


def cpu_s(pid: int) -> float:
    """[s] of processor that a process has had."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextmanager
def listening(stage: Stage, stations: list[str]) -> Iterator[dict[str, Subscriber]]:
    """A subscriber to each station."""
    with ExitStack() as stack:
        caesura = stack.enter_context(stage.reader())
        yield {one: stack.enter_context(Subscriber(caesura, one).listening()) for one in stations}


def watch(page: Page, received: dict[str, Subscriber], seconds: float) -> list[float]:
    """[s] of session time that cards are behind the wire."""
    behind = []
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        wire = {name: reached(one.now) for name, one in received.items() if one.update is not None}
        behind += [wire[name] - t for name, t in page.evaluate(SHOWN) if name in wire]
        page.wait_for_timeout(1000 * LOOK_S)
    return behind


def measure(stage: Stage, browser: Browser, stations: list[str], seconds: float) -> None:
    """Print loading, lag, rate and load."""
    url = stage.dashboard.url
    wall, station = Visitor(browser), Visitor(browser)
    with listening(stage, stations) as received:
        eventually(lambda: all(one.update is not None for one in received.values()))
        for path, seen in (("/", "li.card"), (f"/station/{stations[0]}", ".signals"), ("/system", "table")):
            print(f"load of {path} [s]: {load(browser, url + path, seen)}")
        station.page.goto(f"{url}/station/{stations[0]}")
        wall.page.goto(url)
        wall.page.locator("li.card").nth(len(stations) - 1).wait_for()
        wall.page.wait_for_timeout(3000)
        wall.page.evaluate(COUNT)
        pids = {"dashboard": stage.dashboard.pid, "service": stage.service.pid}
        before, began = {name: cpu_s(pid) for name, pid in pids.items()}, time.monotonic()
        behind = 1000.0 * np.array(watch(wall.page, received, seconds))
        took = time.monotonic() - began
        counts = wall.page.evaluate("() => Object.values(window.changes)")
    median, p99 = np.percentile(behind, [50, 99])
    print(f"behind the wire [ms of session]: median {median:.0f}, 99 % {p99:.0f}, worst {behind.max():.0f}")
    print(f"changes of a card a second: {min(counts) / took:.1f} to {max(counts) / took:.1f}")
    for name, pid in pids.items():
        print(f"{name}: {100 * (cpu_s(pid) - before[name]) / took:.0f} % of a processor")
    station.page.goto(f"{url}/system")
    row = station.page.get_by_role("region", name="This dashboard").locator("tbody td").all_inner_texts()
    print(
        f"sent until seen, as the dashboard has it: median {row[1]}, 99 % within {row[2]}, {row[0]} browsers"
    )


def main() -> None:
    """Teach, look, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--stations", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=20.0)
    options = parser.parse_args()
    stations = [f"cell-{index + 1}" for index in range(options.stations)]
    with tempfile.TemporaryDirectory() as folder, staged(Path(folder)) as stage, chromium() as browser:
        for index, station in enumerate(stations):
            stage.teach(station, taught(index, options.seconds + 60.0))
        print(f"{options.stations} stations at 200 Hz for {options.seconds:g} s; {os.cpu_count()} cores")
        measure(stage, browser, stations, options.seconds)


if __name__ == "__main__":
    main()
