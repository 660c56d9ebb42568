"""What a minute of a station's page costs, by the age of the session that it follows.

A session is sent as fast as the service takes it until it has an age, and at the pace of a robot from
then on. Printed are the seconds of processor that the dashboard, the service and the browser use in a
minute, what the page receives in it, and the memory that the page and the dashboard hold in the end.
A browser that has too little processor draws less often.
Usage: python tests/bench/live_page.py [--ages 30 300 3600] [--seconds 30] [--parts 1]
A page that is open for an hour: --ages 30 --seconds 300 --parts 12
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import astuple, dataclass, replace
from pathlib import Path

from playwright.sync_api import Browser, CDPSession, WebSocket

sys.path.insert(0, str(Path(__file__).parents[1]))

from caesura_clients.dashboard.station_summary import reached
from dashboard.browser import Visitor, chromium
from dashboard.stage import Stage, staged
from dashboard.subscriber import Subscriber
from harness.demonstrations import taught

WARM_UP_S = 10.0  # of the page
MARGIN_S = 30.0  # by which the session goes on


@dataclass
class PageTraffic:
    """What a page received: bytes and messages of its socket, bytes and answers for its plots."""

    pushed: int = 0
    messages: int = 0
    fetched: int = 0
    answers: int = 0

    def watch(self, visitor: Visitor) -> None:
        """Count from here on."""
        visitor.page.on("websocket", self._watch_socket)
        visitor.page.on("response", lambda found: self._count(found.url, found.headers))

    def _watch_socket(self, socket: WebSocket) -> None:
        socket.on("framereceived", self._push)

    def _push(self, frame: str | bytes) -> None:
        self.pushed += len(frame)
        self.messages += 1

    def _count(self, url: str, headers: dict[str, str]) -> None:
        if "/samples/" in url:
            self.answers += 1
            self.fetched += int(headers.get("content-length", 0))


def cpu_s(pid: int) -> float:
    """[s] of processor that a process has had."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def browser_cpu_s() -> dict[int, float]:
    """[s] of processor of each process of the browser that this process has started."""
    stats = {}
    for file in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):  # it has ended
            name, _, fields = file.read_text().partition("(")[2].rpartition(")")
            stats[int(file.parent.name)] = name, int(fields.split()[1])
    children = {os.getpid()}
    while more := {pid for pid, (_, parent) in stats.items() if parent in children} - children:
        children |= more
    found = {}
    for pid in children:
        with suppress(OSError):
            if "chrom" in stats[pid][0]:
                found[pid] = cpu_s(pid)
    return found


def memory_mb(pid: int) -> float:
    """[MB] of memory that a process holds."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


class OpenPage:
    """A page of a station that is open, with what it costs since the last look at it."""

    def __init__(self, stage: Stage, browser: Browser, station: str) -> None:
        self.visitor, self.counts = Visitor(browser), PageTraffic()
        self._pids = {"dashboard": stage.dashboard.pid, "service": stage.service.pid}
        self.counts.watch(self.visitor)
        self.visitor.page.goto(f"{stage.dashboard.url}/station/{station}")
        self.visitor.page.locator(".app").first.wait_for()
        self._devtools: CDPSession = self.visitor.page.context.new_cdp_session(self.visitor.page)

    def cost(self, seconds: float) -> str:
        """What the next seconds cost, in a line."""
        before, first = {name: cpu_s(pid) for name, pid in self._pids.items()}, browser_cpu_s()
        start, began = replace(self.counts), time.monotonic()
        self.visitor.page.wait_for_timeout(1000 * seconds)
        minutes = (time.monotonic() - began) / 60.0
        used = {name: (cpu_s(pid) - before[name]) / minutes for name, pid in self._pids.items()}
        used["browser"] = sum(now - first.get(pid, 0.0) for pid, now in browser_cpu_s().items()) / minutes
        pushed, messages, fetched, answers = (
            (now - then) / minutes for now, then in zip(astuple(self.counts), astuple(start), strict=True)
        )
        words = "  ".join(f"{name} {value:5.1f}" for name, value in used.items())
        return (
            f"[s of processor] {words}   {pushed / 1e6:6.2f} MB in {messages:.0f} messages, "
            f"{fetched / 1e6:.2f} MB in {answers:.0f} answers   {self._memory()}"
        )

    def _memory(self) -> str:
        self._devtools.send("HeapProfiler.collectGarbage")
        heap = self._devtools.send("Runtime.getHeapUsage")["usedSize"] / 1e6
        nodes = self._devtools.send("Memory.getDOMCounters")["nodes"]
        return f"heap {heap:5.1f} MB, {nodes} nodes, dashboard {memory_mb(self._pids['dashboard']):.0f} MB"


def measure(stage: Stage, browser: Browser, age_s: float, seconds: float, parts: int) -> None:
    """Print a row for each part of the time."""
    station = f"cell-{age_s:g}"
    recording = taught(7, age_s + WARM_UP_S + seconds * parts + MARGIN_S)
    with (
        stage.reader() as reader,
        Subscriber(reader, station).listening() as received,
        stage.aged(station, recording, age_s),
    ):
        received.until(lambda: received.update is not None and reached(received.now) >= age_s)
        page = OpenPage(stage, browser, station)
        page.visitor.page.wait_for_timeout(1000 * WARM_UP_S)
        for _ in range(parts):
            cost = page.cost(seconds)
            count = len(received.now.program.apps)
            print(f"{reached(received.now):6.0f} s {count:5d} apps   {cost}", flush=True)
        print(*page.visitor.errors, sep="\n", flush=True)
        page.visitor.close()


def main() -> None:
    """Teach, look, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ages", type=float, nargs="+", default=[30.0, 300.0, 3600.0])
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--parts", type=int, default=1, help="rows of so many seconds each, of one page")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, staged(Path(folder)) as stage, chromium() as browser:
        for age_s in options.ages:
            measure(stage, browser, age_s, options.seconds, options.parts)


if __name__ == "__main__":
    main()
