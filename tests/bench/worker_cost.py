"""What a batch costs on its whole way through a service, without the network; or of two checkouts in turn.

From the received payload to the result's payload, through budgets, queue and worker, with the real journal:
µs of processor time of the process and of the worker. Stations teach five tasks, begun at five places. A
machine varies by more than most changes are worth. So with --against both checkouts work in slices of a
fraction of a second, one after the other, and the median of the ratios is printed.
Usage: python tests/bench/worker_cost.py [--stations N] [--against DIRECTORY] [--json DIR]
DIRECTORY: another checkout, as of `git worktree add DIRECTORY COMMIT`, whose kernels are compiled at first.
"""

from __future__ import annotations

import inspect
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from itertools import cycle, islice, product
from pathlib import Path
from typing import Any

from machine import options, report
from service_load import BATCH_S, OBSERVED_S, PLACES, TASKS, WARM_UP_S, prepared

from caesura_protocol.codec import Encoded, decode
from caesura_protocol.keys import station_key
from caesura_protocol.messages import Control
from caesura_service.app import segmenting_pipeline
from caesura_service.decimation import SampleReader
from caesura_service.journal import JournalBatches, SqliteJournal
from caesura_service.monitoring.instrumented_registry import InstrumentedRegistry
from caesura_service.publishing.events import Owner
from caesura_service.server import NetworkSettings, ZenohServer
from caesura_service.server.budgets import Budgets
from caesura_service.server.network_interface import Incoming
from caesura_service.server.outbound import ResultPublisher
from caesura_service.server.rate_limit_settings import RateLimits
from caesura_service.server.worker import TICK_S, Worker
from caesura_service.sessions.limits import Limits

HERE = Path(__file__).resolve()
ROOMS = ("protocol", "service", "clients", "lab")
IN_A_SLICE = 5  # batches of each station, with which an observation is complete
OWNER = Owner("bench", 1)
SERVE, GO = "--serve", "go\n"
Costs = tuple[float, float]  # [µs] a batch: of the process, and of the worker


class Unread:
    """In place of the network: results are encoded, and no subscriber reads them."""

    def declare_publisher(self, key: str, priority: str) -> Unread:
        """Return a publisher of any key."""
        return self

    def put(self, *content: Encoded | str) -> None:
        """Do nothing."""

    def undeclare(self) -> None:
        """Do nothing."""


class SoleOwner:
    """In place of what manages stations: all of them are this instance's."""

    def idle_s(self) -> float:
        """Return [s] until there is something to do."""
        return 1.0


def main() -> None:
    """Print what a batch costs, or serve as the process that is measured."""
    parser = options(__doc__)
    parser.add_argument("--stations", type=int, default=25)
    parser.add_argument("--against", type=Path, metavar="DIRECTORY")
    parser.add_argument(SERVE, action="store_true")
    asked = parser.parse_args()
    if asked.serve:
        for process_us, worker_us in slices(asked.stations):
            print(process_us, worker_us, flush=True)
        return
    here = HERE.parents[2]
    costs = list(in_turn([here, asked.against] if asked.against else [here], asked.stations))
    rows: list[Sequence[object]] = []
    for number, name in enumerate(("process", "worker's thread")):
        own = [each[0][number] for each in costs]
        ratios = [each[0][number] / each[1][number] for each in costs if asked.against]
        quartiles = statistics.quantiles(own, n=4)
        rows.append((name, min(own), *quartiles, *(statistics.quantiles(ratios, n=4) if ratios else ())))
    columns = ["of the", "least [µs]", "a quarter below", "median", "a quarter above"]
    columns += ["ratio: a quarter below", "median ratio", "ratio: a quarter above"] if asked.against else []
    report("worker_cost", f"{asked.stations} stations, {len(costs)} slices", columns, rows, asked.json)


def in_turn(checkouts: Sequence[Path], stations: int) -> Iterator[list[Costs]]:
    """What a batch costs in each checkout, slice by slice."""
    processes = [serving(checkout.resolve(), stations) for checkout in checkouts]
    try:
        for turn in cycle((1, -1)):
            costs = [one_slice(process) for process in processes[::turn]][::turn]
            if not all(costs):
                return
            yield [cost for cost in costs if cost]
    finally:
        for process in processes:
            process.kill()
            process.wait()


def serving(checkout: Path, stations: int) -> subprocess.Popen[str]:
    """A process with the packages of a checkout."""
    path = os.pathsep.join(str(checkout / room) for room in ROOMS)
    command = [sys.executable, str(HERE), SERVE, "--stations", str(stations)]
    pipe, environment = subprocess.PIPE, {**os.environ, "PYTHONPATH": path}
    return subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=environment)


def one_slice(process: subprocess.Popen[str]) -> Costs | None:
    """Have a process do its next slice; None where there is none."""
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(GO)
    process.stdin.flush()
    answer = process.stdout.readline().split()
    return (float(answer[0]), float(answer[1])) if answer else None


# --- the process that is measured -----------------------------------------------------------------------


def slices(stations: int) -> Iterator[Costs]:
    """Do a slice for each line of the standard input; yield what its batches cost."""
    now = [1e3]  # [s] the clock, which goes as fast as the work does
    with tempfile.TemporaryDirectory() as directory, SqliteJournal(Path(directory) / "journal") as journal:
        registry = InstrumentedRegistry(
            owner=OWNER,
            pipeline_factory=segmenting_pipeline(),
            default_preset="default",
            journal=journal,
            limits=Limits(),
        )
        reader = SampleReader(JournalBatches(journal))
        server = ZenohServer(
            registry, OWNER, NetworkSettings(), version="", samples=reader, clock=lambda: now[0]
        )
        server.budgets = budgets = Budgets(RateLimits(), clock=lambda: now[0])
        network: Any = Unread()
        manager: Any = SoleOwner()
        publisher = publisher_of(network, server._queue, budgets)
        worker = Worker(registry, manager, server._queue, publisher, budgets, lambda: now[0])
        plan, next_tick_s = planned(registry, stations), 0.0
        while arrivals := list(islice(plan, IN_A_SLICE * stations)):
            if arrivals[0][0] >= WARM_UP_S and not sys.stdin.readline():
                return
            began = time.process_time(), time.thread_time()
            for due_s, key, batch in arrivals:
                now[0] = 1e3 + due_s
                if due_s >= next_tick_s:
                    next_tick_s = due_s + TICK_S
                    worker.emit(registry.tick(now[0]))
                server._handle_samples(Incoming(key, batch.payload, batch.encoding))
                worker._process_some(1, 0.0)
            if arrivals[0][0] >= WARM_UP_S:
                spent = time.process_time() - began[0], time.thread_time() - began[1]
                yield 1e6 * spent[0] / len(arrivals), 1e6 * spent[1] / len(arrivals)
        sys.stdin.readline()  # the end of the process is the answer


def publisher_of(network: Any, *queue_and_budgets: Any) -> ResultPublisher:
    """Return what publishes the results; in an older checkout it makes the publishers of its keys itself."""
    given: list[Any] = [network, *queue_and_budgets, None]  # no lanes: no station asks, or is asked
    if "publishers" in inspect.signature(ResultPublisher).parameters:
        from caesura_service.server.key_publishers import KeyPublishers  # noqa: PLC0415
        from caesura_service.server.station_send_threads import StationSendThreads  # noqa: PLC0415

        given.append(KeyPublishers(network, StationSendThreads()))
    return ResultPublisher(*given)


def planned(registry: InstrumentedRegistry, stations: int) -> Iterator[tuple[float, str, Encoded]]:
    """Open a session a station; when [s] each of its batches is due, on which key, and the batch."""
    taught = list(islice(cycle([prepared(*one) for one in product(TASKS, range(PLACES))]), stations))
    plan: list[tuple[float, str, int]] = []
    content: dict[str, Sequence[Encoded]] = {}
    for place, (batches, opening) in enumerate(taught):
        name = f"cell-{place + 1}"
        registry.handle_command(name, decode(opening.payload, opening.encoding, Control).command, 0.0)
        key, late_s = station_key(name, "samples"), OBSERVED_S * place / stations
        content[key] = batches
        plan += [((seq + 1) * BATCH_S + late_s, key, seq) for seq in range(len(batches))]
    return ((due_s, key, content[key][seq]) for due_s, key, seq in sorted(plan))


if __name__ == "__main__":
    main()
