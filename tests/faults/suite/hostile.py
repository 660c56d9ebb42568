"""One station that sends what is costly to read: no other loses anything, memory and log do not grow."""

from __future__ import annotations

import json
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

from caesura_clients import connect
from faults.suite.outcome import FULL, Disturbance, Row, Scale, played
from faults.suite.stations import CONNECT_S, TaughtStation, reached
from harness.processes import Process, ServiceProcess, running

SCRIPT = str(Path(__file__).with_name("hostile_process.py"))
# What is sent → how often a second, and how often at least, or it proves nothing.
ATTACKS = {"columns": (20.0, 45), "nesting": (4000.0, 5000)}
GROWTH_MB = 150  # of the service, at most at once, from before the attack
LOG_BYTES = 20_000


class Reporting(Process):
    """Writes a report when it is ended."""

    def __init__(self, report: Path, *command: str) -> None:
        self._report = report
        super().__init__([sys.executable, SCRIPT, *command, str(report)])

    def report(self) -> dict[str, int]:
        assert self.end() == 0
        found: dict[str, int] = json.loads(self._report.read_text())
        return found


class LoggedService(ServiceProcess):
    """With its log in a file."""

    def begin(self) -> None:
        with (self.journal / "log").open("a") as log:
            self._process = subprocess.Popen(self.command, stdout=subprocess.PIPE, stderr=log, text=True)

    @property
    def log(self) -> str:
        return (self.journal / "log").read_text()

    def peak_mb(self) -> int:
        """The most memory that it ever had."""
        status = Path(f"/proc/{self.pid}/status").read_text()
        (line,) = [line for line in status.splitlines() if line.startswith("VmHWM")]
        return int(line.split()[1]) // 1024


def hostile(what: str, directory: Path, scale: Scale = FULL, share: float = 1.0) -> Row:
    """From the first samples to the last. share: of how much is to be sent at least."""
    per_s, least = ATTACKS[what]

    def disturb(stations: list[TaughtStation], _: Disturbance) -> None:
        reached(stations, 0.1)
        before.append(service.peak_mb())
        attacker.start()
        reached(stations, 1.0)

    with running(LoggedService(directory)) as service, ExitStack() as stack:
        before: list[int] = []
        attacker = Reporting(directory / "attack", "attack", service.endpoint, what, str(per_s))
        dashboard = Reporting(directory / "dashboard", "dashboard", service.endpoint)
        stack.callback(attacker.kill)
        stack.callback(dashboard.kill)
        dashboard.start()
        done = played(service.endpoint, directory, disturb, scale=scale)
        grown_mb, sent, seen = service.peak_mb() - before[0], attacker.report(), dashboard.report()
        with connect(service.endpoint, timeout_s=CONNECT_S) as caesura:
            refused = sum(sum(status.refused.values()) for status in caesura.services())
        log = service.log
    note = (
        f"{sent['put']} batches put, {refused} refused; "
        f"{sent['answered']} of {sent['asked']} commands answered; "
        f"service grew {grown_mb} MB, log {len(log)} bytes, {log.count('Traceback')} tracebacks; "
        f"dashboard began again {seen['restarts']} times, {seen['peak_mb']} MB"
    )
    met = (
        refused >= share * least
        and sent["answered"] == sent["asked"] > 0
        and grown_mb < GROWTH_MB
        and len(log) < LOG_BYTES
        and "Traceback" not in log
        and not seen["restarts"]
        and seen["received"] >= len(done.found)
    )
    return done.row(note=note, met=met)
