"""What the network side of a service costs: µs of processor time a batch of 20 samples, thread by thread.

A real zenoh over loopback: another process puts the batches of many 1 kHz robots when they are due, and hears
the results; here is an Edge before a registry that answers every batch with what a session says on average
(results of three kinds every fifth batch) and keeps the interpreter busy for as long as the work takes, see
`batch_cost.py`. That time is not counted; reading the messages and writing them is.
Usage: python tests/bench/edge_cost.py [--behind] [--stations N] [--seconds S] [--work US] [--json DIR]
--behind: the edge is client of a router in another process, like each of several instances.
"""

from __future__ import annotations

import multiprocessing
import sys
import threading
import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from machine import options, report
from service_load import BATCH_S, OBSERVED_S, SESSION, prepared

from caesura_protocol.keys import session_key, station_key
from caesura_protocol.messages import Changepoints, Heartbeat, Posterior, SampleBatch, Segments
from caesura_protocol.transport.inbox import Inbox
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from caesura_service.app import SWITCH_INTERVAL_S
from caesura_service.decimation import SampleReader
from caesura_service.journal import JournalBatches, MemoryJournal
from caesura_service.ownership.registry import Registry
from caesura_service.publishing.events import Output, Owner, Publish, ReplayEnded
from caesura_service.server import NetworkSettings, ZenohServer
from caesura_service.server.network_join import join
from caesura_service.server.work_queue import QueueSettings
from caesura_service.sessions.limits import Limits
from harness.fake_pipeline import make_fake_pipeline

OWNER = Owner("bench", 1)
WARM_UP_S, WIND_DOWN_S = 2.0, 1.0
WORKER = "caesura-worker"
CALLBACKS, SENDERS = ("rx-", "net-"), ("tx-", "app-", "acc-")  # as zenoh calls its own threads
HYPOTHESES = 50


class WorkingRegistry(Registry):
    """Answers every batch without looking at it, after `work_s` of work."""

    def __init__(self, work_s: float) -> None:
        super().__init__(
            owner=OWNER,
            pipeline_factory=make_fake_pipeline,
            default_preset="fake",
            journal=MemoryJournal(),
            limits=Limits(),
        )
        self.work_s, self.worked_s, self.batches = work_s, 0.0, 0

    def handle_samples(
        self, station: str, message: SampleBatch | Heartbeat | ReplayEnded, now: float
    ) -> list[Output]:
        """What a session says on average."""
        began = time.thread_time()
        self.batches += 1
        assert isinstance(message, SampleBatch)
        observed = message.seq % round(OBSERVED_S / BATCH_S) == 0
        said: list[Output] = [Publish(result) for result in results_of(station)] if observed else []
        while time.thread_time() - began < self.work_s:
            pass
        self.worked_s += time.thread_time() - began
        return said


def results_of(station: str) -> list[Changepoints | Segments | Posterior]:
    """What an observation brings, of the usual size."""
    common: dict[str, Any] = {
        "station": station,
        "session": SESSION,
        "instance": OWNER.instance,
        "epoch": OWNER.epoch,
        "seq": 0,
        "t": 0.0,
    }
    starts = tuple(0.1 * index for index in range(HYPOTHESES))
    return [
        Changepoints(**common, first=0, changepoints=()),
        Segments(**common, first=0, segments=()),
        Posterior(**common, starts=starts, probabilities=(1.0 / HYPOTHESES,) * HYPOTHESES),
    ]


def main() -> None:
    """Serve what the other process puts, and look at the threads."""
    parser = options(__doc__)
    parser.add_argument("--stations", type=int, default=24)
    parser.add_argument("--seconds", type=float, default=9.0)
    parser.add_argument("--work", type=float, default=300.0, help="µs")
    parser.add_argument("--behind", action="store_true")
    asked = parser.parse_args()
    if asked.seconds <= WARM_UP_S + WIND_DOWN_S:
        parser.error(f"--seconds is {asked.seconds:g}, expected more than {WARM_UP_S + WIND_DOWN_S:g}")
    context = multiprocessing.get_context("spawn")
    received: Any = context.Queue()
    network = NetworkSettings("tcp/127.0.0.1:0")
    if asked.behind:
        context.Process(target=router, args=(received,), daemon=True).start()
        network = NetworkSettings(connect=received.get())
    registry = WorkingRegistry(1e-6 * asked.work)
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    reader = SampleReader(JournalBatches(MemoryJournal()))
    with ZenohServer(
        registry, OWNER, network, version="bench", samples=reader, queue=QueueSettings()
    ) as edge:
        names = [f"cell-{number}" for number in range(asked.stations)]
        others = context.Process(
            target=robots, args=(edge.endpoint, names, asked.seconds, received), daemon=True
        )
        others.start()
        received.get()  # the first batch is about to be put
        time.sleep(WARM_UP_S)
        before, batches, worked_s = spent(), registry.batches, registry.worked_s
        time.sleep(asked.seconds - WARM_UP_S - WIND_DOWN_S)
        after, batches, worked_s = spent(), registry.batches - batches, registry.worked_s - worked_s
        others.join()
        print(f"{registry.batches} batches, {edge.status().dropped} dropped, {received.get()} results heard")
    took = {name: s - before.get(name, 0.0) for name, s in after.items()}
    took[WORKER] -= worked_s
    rows = [(name, 1e6 * s / batches) for name, s in sorted(took.items(), key=lambda x: -x[1])]
    rows.append(("all", sum(us for _, us in rows)))
    report("edge_cost", f"{asked.stations} stations", ("thread", "µs a batch"), rows, asked.json)


def spent() -> Mapping[str, float]:
    """[s] of processor time of this process so far, by kind of thread."""
    found: Counter[str] = Counter()
    own = {thread.native_id: thread.name for thread in threading.enumerate()}
    for path in Path("/proc/self/task").iterdir():
        try:
            name = own.get(int(path.name)) or (path / "comm").read_text().strip()
            found[kind_of(name)] += time.clock_gettime(~int(path.name) << 3 | 6)  # Linux: that thread's
        except OSError:  # has ended meanwhile
            continue
    return found


def kind_of(name: str) -> str:
    """What a thread is here, by its name."""
    if name.startswith(CALLBACKS):
        return "network, in (with callbacks)"
    return "network, out" if name.startswith(SENDERS) else name


def router(reported: Any) -> None:
    """Between the edge and the robots, until killed."""
    _, endpoint = join(NetworkSettings("tcp/127.0.0.1:0"), threading.Event())
    reported.put(endpoint)
    threading.Event().wait()


def robots(endpoint: str, names: list[str], seconds: float, received: Any) -> None:
    """Put every station's batches when they are due, and hear the results."""
    inbox = Inbox(capacity=1 << 20)
    batches = prepared()[0][: round(seconds / BATCH_S)]
    plan = sorted(
        ((seq + 1) * BATCH_S + OBSERVED_S * place / len(names), station_key(name, "samples"), batch)
        for place, name in enumerate(names)
        for seq, batch in enumerate(batches)
    )
    with (
        ZenohTransport(endpoint, timeout_s=10.0) as transport,
        transport.subscribe(session_key("*", "*", "posterior"), inbox),
    ):
        received.put("begin")
        begun = time.monotonic()
        for due, key, batch in plan:
            if (ahead := begun + due - time.monotonic()) > 0.0:
                time.sleep(ahead)
            transport.put(key, batch)
        time.sleep(0.5)
    results = 0
    while inbox.get(0.0) is not None:
        results += 1
    received.put(results)


if __name__ == "__main__":
    main()
