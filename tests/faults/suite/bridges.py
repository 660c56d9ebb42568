"""Bridges are killed in the middle of a session and started again: what they took with them is a gap."""

from __future__ import annotations

import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from caesura_protocol.messages import Ack
from faults.suite.bridge_process import PACE
from faults.suite.outcome import Disturbance, Played, Row
from faults.suite.stations import SECONDS as LASTS_S
from faults.suite.stations import STATIONS, TaughtStation, found, station_name, teaching, watching
from harness.processes import Process, eventually, running, serving

KILLED = 4
SHARES = (0.15, 0.25, 0.35, 0.45)  # of the demonstrations, when they are


def passed(moment: float) -> bool:
    """Of the time of day [s]."""
    return time.time() >= moment


class BridgeProcess(Process):
    """`bridge_process`; every start takes the session up with a higher epoch."""

    def __init__(self, endpoint: str, number: int, began: Path) -> None:
        self.number, self.epoch, self._began = number, -1, str(began)
        self._start_of_command = [sys.executable, "-m", "faults.suite.bridge_process", endpoint, str(number)]
        super().__init__(self._start_of_command)

    def begin(self) -> None:
        self.epoch += 1
        self.command = [*self._start_of_command, str(self.epoch), self._began]
        super().begin()

    def ack(self) -> Ack:
        """The service's last word to the bridge."""
        assert self._process is not None
        assert self._process.stdout is not None
        return Ack.model_validate_json(self._process.stdout.readline())


def bridges_killed(directory: Path) -> Row:
    """Half of the stations, at different moments; the other half is not to notice."""
    with serving(directory) as service, watching(service.endpoint) as watched, ExitStack() as stack:
        began = directory / "began"
        processes = [BridgeProcess(service.endpoint, number, began) for number in range(KILLED, STATIONS)]
        for process in processes:
            stack.enter_context(running(process))
        began_s = time.time()
        began.with_suffix(".new").write_text(str(began_s))
        began.with_suffix(".new").rename(began)
        others = stack.enter_context(teaching(service.endpoint, numbers=range(KILLED), pace=PACE))
        disturbance = Disturbance()
        for share, process in zip(SHARES, processes, strict=True):
            eventually(partial(passed, began_s + share * LASTS_S / PACE))
            process.kill()
            disturbance.is_over()
            process.begin()  # and kill the next one in time, however slowly this one starts
        for process in processes:
            process.ready()
        pool = stack.enter_context(ThreadPoolExecutor(KILLED))
        killed = [TaughtStation(p.number, LASTS_S, None, pool.submit(p.ack)) for p in processes]
        done = found(service.endpoint, killed, directory)
        whole = Played(found(service.endpoint, others, directory), watched, Disturbance()).row()
    recovery_s = max(
        watched.recovery_s([station_name(process.number)], over)
        for process, over in zip(processes, disturbance.over, strict=True)
    )
    row = Played(done, watched, Disturbance()).row("gap")
    gaps = sum(len(one.snapshot.status.gaps) for one in done)
    note = f"{KILLED} killed: {gaps} gaps; the others lost {whole.lost}, equal: {whole.equal}; {row.note}"
    return Row(
        sessions=STATIONS,
        sent=row.sent + whole.sent,
        lost=row.lost + whole.lost,
        duplicated=row.duplicated + whole.duplicated,
        equal=f"{whole.equal} (others)",
        recovery_s=recovery_s,
        note=note.rstrip("; "),
        met=row.met and whole.met and gaps >= KILLED,
    )
