"""Whether memory, threads and files grow over hours: sessions back to back, a dashboard, and a `watch`.

Each station plays recordings of `data/` as one session after another, and asks for its snapshot and program
after each. Prints, once a minute, the sessions so far and what each process holds; asserts nothing.
Usage: python tests/bench/soak.py [--minutes 60] [--stations 4] [--pace 2.5] [--json DIR]
"""

from __future__ import annotations

import os
import random
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

from machine import machine, options, report

sys.path.append(str(Path(__file__).resolve().parents[1]))
from caesura_clients import connect
from caesura_clients.bridge import Bridge
from caesura_clients.bridge.sources.file import FileSource
from caesura_protocol.formats.read import load_recording
from clients.conftest import free_port
from harness.processes import CAESURA, QUICK, ServiceProcess, environment, started

DATA = Path(__file__).resolve().parents[2] / "data"
TASKS = ("button", "parkour", "pick_and_place", "wiping", "three_point", "dispenser")
LOOK_S = 60.0
COLUMNS = ("minutes", "sessions", "process", "MB", "threads", "files", "processor [s]")


class Stations:
    """Stations that teach until the context ends; an error ends its station, and is kept."""

    def __init__(self, endpoint: str, count: int, pace: float) -> None:
        self._endpoint, self._pace = endpoint, pace
        self._recordings = [load_recording(DATA / f"{task}.npz") for task in TASKS]
        self._over = threading.Event()
        self.sessions = 0
        self.errors: list[str] = []
        self._threads = [threading.Thread(target=self._run, args=(n,), daemon=True) for n in range(count)]

    def __enter__(self) -> Stations:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        for thread in self._threads:
            thread.join()

    def _run(self, number: int) -> None:
        chance, station = random.Random(number), f"cell-{number}"
        try:
            with connect(self._endpoint) as caesura:
                while not self._over.is_set():
                    source = FileSource(chance.choice(self._recordings), pace=self._pace)
                    name = f"s{self.sessions}-{number}"
                    with Bridge(caesura.transport, station, source, session=name, settings=QUICK) as bridge:
                        bridge.run()
                    caesura.snapshot(station, name)
                    caesura.program(station)
                    self.sessions += 1
        except Exception as error:
            self.errors.append(f"{station}: {error!r}")


def held(pid: int) -> tuple[int, int, int, float]:
    """Memory [MB], threads and files of a process, and the processor time [s] that it took."""
    status = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text().splitlines())
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    processor_s = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    files = len(os.listdir(f"/proc/{pid}/fd"))
    return int(status["VmRSS"].split()[0]) // 1024, int(status["Threads"]), files, processor_s


def main() -> None:
    """Teach, and look at the processes once a minute."""
    parser = options(__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--stations", type=int, default=4)
    parser.add_argument("--pace", type=float, default=2.5)
    asked = parser.parse_args()
    print(", ".join(f"{name} {value}" for name, value in machine().items()))
    rows: list[tuple[object, ...]] = []
    with tempfile.TemporaryDirectory() as directory, ExitStack() as stack:
        service = ServiceProcess(Path(directory))
        service.start()
        stack.callback(service.end)
        beside = {
            "dashboard": ("dashboard", "--insecure", "--port", str(free_port())),
            "watch": ("watch",),
        }
        pids: Mapping[str, int] = {"service": service.pid} | {
            name: stack.enter_context(
                started(
                    [*CAESURA, *command, "--connect", service.endpoint],
                    stdout=subprocess.DEVNULL,
                    env=environment(),
                )
            ).pid
            for name, command in beside.items()
        }
        stations = stack.enter_context(Stations(service.endpoint, asked.stations, asked.pace))
        began = time.monotonic()
        while (minutes := (time.monotonic() - began) / 60.0) < asked.minutes:
            time.sleep(min(LOOK_S, 60.0 * (asked.minutes - minutes)))
            minutes = (time.monotonic() - began) / 60.0
            rows += [(minutes, stations.sessions, name, *held(pid)) for name, pid in pids.items()]
            print("; ".join(f"{name} {mb} MB" for _, _, name, mb, *_ in rows[-len(pids) :]), flush=True)
    title = f"{stations.sessions} sessions, {len(stations.errors)} errors"
    report("soak", title, COLUMNS, rows, asked.json)
    print(*stations.errors, sep="\n")


if __name__ == "__main__":
    main()
