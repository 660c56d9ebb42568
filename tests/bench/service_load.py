"""How many stations a service holds: 1 kHz robots, 20 samples a batch, real processes over loopback.

The number of stations grows step by step, until the 99th percentile of the time from putting the batch that
completes an observation to receiving its result passes 50 ms, or anything is lost. Robots and reader are two
processes beside the service, on the same cores, and do no more than put and receive. Prints the stations
held, and at each step latencies, the service's processor time and memory a station, and the machine's pace.
People teach each at their own time: five tasks, from five places on, and observations that are due at times
spread evenly over a tenth of a second. In lockstep all of them do the same thing at the same moment.
Usage: python tests/bench/service_load.py [--stations 8 16 …] [--instances N] [--lockstep] [--json DIR]
"""

from __future__ import annotations

import multiprocessing
import os
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import zenoh
from machine import machine, options, pace_ms, report

from caesura_clients.query import snapshot
from caesura_protocol.codec import Encoded, decode, encode, pack_samples
from caesura_protocol.errors import CaesuraError, ProtocolError
from caesura_protocol.formats.read import load_recording
from caesura_protocol.keys import parse_replay_parameters, parse_station_key, session_key, station_key
from caesura_protocol.messages import Ack, Control, Open, Posterior
from caesura_protocol.transport.inbox import Inbox, ReceivedSample, TokenChange
from caesura_protocol.transport.zenoh_transport import ZenohTransport

sys.path.append(str(Path(__file__).resolve().parents[1]))
from harness.peer import Peer
from harness.processes import ServiceProcess

DATA = Path(__file__).resolve().parents[2] / "data"
TASKS = ("pick_and_place", "three_point", "wiping", "dispenser", "button")
PLACES = 5  # of a recording, from which on it is taught
SESSION, BATCH, BATCH_S, DELAY_S = "load", 20, 0.02, 0.055
OBSERVED_S = 0.1  # from one observation to the next
QUIET_S = 3.0  # without a result: no more will come
SECONDS, WARM_UP_S = 10.0, 2.0
CATCH_UP_S = 60.0  # after which what a service lacks counts as lost
LIMIT_MS = 50.0
STEPS = (8, 16, 24, 32, 40, 48, 64, 96, 128)
NETWORK_THREADS = ("rx-", "tx-", "acc-", "app-", "net-")  # as zenoh calls its own


class LoadResult(NamedTuple):
    """What a number of stations came to."""

    lost: int  # samples
    latencies_ms: Sequence[float]
    processor: float  # cores that the service took
    network: float  # share of that in the network's own threads
    memory_mb: float
    pace_ms: float  # of the machine, just before


def main() -> None:
    """Grow until it no longer holds."""
    parser = options(__doc__)
    parser.add_argument("--stations", type=int, nargs="*", default=STEPS)
    parser.add_argument("--instances", type=int, default=1)
    parser.add_argument("--lockstep", action="store_true")
    asked = parser.parse_args()
    print(", ".join(f"{name} {value}" for name, value in machine().items()))
    rows, held = [], 0
    for stations in asked.stations:
        load = measured(stations, asked.instances, lockstep=asked.lockstep)
        rows.append(row(stations, load))
        if load.lost or np.percentile(load.latencies_ms, 99) > LIMIT_MS:
            break
        held = stations
    columns = (
        "stations",
        "lost",
        "results",
        "p50 [ms]",
        "p99",
        "p99.9",
        "cores",
        "% of a core a station",
        "network [%]",
        "MB a station",
        "pace [ms]",
    )
    title = f"{held} stations held, {asked.instances} instance(s): p99 at most {LIMIT_MS:g} ms, nothing lost"
    report("service_load", title, columns, rows, asked.json)


def row(stations: int, load: LoadResult) -> tuple[object, ...]:
    """As it is printed."""
    p50, p99, p999 = (float(np.percentile(load.latencies_ms, p)) for p in (50, 99, 99.9))
    share = 100.0 * load.processor / stations
    results = len(load.latencies_ms)
    network, memory_mb = 100.0 * load.network, load.memory_mb / stations
    return (
        stations,
        load.lost,
        results,
        p50,
        p99,
        p999,
        load.processor,
        share,
        network,
        memory_mb,
        load.pace_ms,
    )


def measured(
    stations: int,
    instances: int,
    *,
    lockstep: bool,
    beside: Callable[[str], AbstractContextManager[None]] = nullcontext,
) -> LoadResult:
    """One service, so many stations at once. beside: what else uses the service, by its endpoint."""
    names = [f"cell-{number}" for number in range(1, stations + 1)]
    pace = pace_ms()
    with tempfile.TemporaryDirectory() as directory, ExitStack() as stack:
        many = ("--instances", str(instances)) if instances > 1 else ()
        service = ServiceProcess(Path(directory), *many)
        service.start()
        stack.callback(service.end)
        stack.enter_context(beside(service.endpoint))
        context = multiprocessing.get_context("spawn")
        reported: Any = context.Queue()
        reader = context.Process(target=read, args=(service.endpoint, len(names), reported), daemon=True)
        reader.start()
        reported.get()  # it listens
        over = context.Event()
        robots = context.Process(
            target=robot, args=(service.endpoint, names, lockstep, reported, over), daemon=True
        )
        before_mb = memory_mb(service.pid)
        robots.start()
        begun = reported.get()  # all sessions are open
        time.sleep(max(0.0, begun + WARM_UP_S - time.monotonic()))
        before, since = processor_s(service.pid), time.monotonic()
        time.sleep(max(0.0, begun + SECONDS - time.monotonic()))
        spent_s, network_s = np.subtract(processor_s(service.pid), before).tolist()
        cores = spent_s / (time.monotonic() - since)
        grown_mb = memory_mb(service.pid) - before_mb
        put_at = reported.get()
        received = reported.get()
        with ZenohTransport(service.endpoint, timeout_s=10.0) as transport:
            lost = missing(transport, names, len(next(iter(put_at.values()))))
        over.set()
        robots.join()
        reader.join()
    return LoadResult(lost, list(latencies(put_at, received)), cores, network_s / spent_s, grown_mb, pace)


def latencies(put_at: dict[str, list[float]], received: list[tuple[str, float, float]]) -> Iterator[float]:
    """[ms] from putting the batch that completes an observation to its result, after the warm-up."""
    for station, t, at in received:
        batch = int(np.ceil((t + DELAY_S - 1e-9) / BATCH_S)) - 1
        if t >= WARM_UP_S and batch < len(put_at.get(station, ())):
            yield 1e3 * (at - put_at[station][batch])


def missing(transport: ZenohTransport, names: Sequence[str], batches: int) -> int:
    """Samples that were put and that no session has, however long the service takes for them."""
    deadline = time.monotonic() + CATCH_UP_S
    while True:
        lost = sum(batches * BATCH - taken(transport, name) for name in names)
        if not lost or time.monotonic() > deadline:
            return lost
        time.sleep(0.2)


def taken(transport: ZenohTransport, name: str) -> int:
    """Samples that a session has."""
    try:
        return snapshot(transport, name, SESSION).status.samples
    except (CaesuraError, ProtocolError):
        return 0  # not to be had just now


# --- the other processes --------------------------------------------------------------------------------


def robot(endpoint: str, names: Sequence[str], lockstep: bool, reported: Any, over: Any) -> None:
    """Put every station's batches when they are due, and tell when that was.

    over: until it is set, the service gets the batches that it asks for.
    """
    taught = [prepared(*one) for one in ([(TASKS[0], 0)] if lockstep else product(TASKS, range(PLACES)))]
    opening = taught[0][1]
    content = {name: taught[place % len(taught)][0] for place, name in enumerate(names)}
    spread_s = BATCH_S if lockstep else OBSERVED_S
    with (
        ZenohTransport(endpoint, timeout_s=10.0) as transport,
        Peer(endpoint) as peer,
        ExitStack() as stack,
    ):
        for name in names:
            stack.enter_context(transport.declare_token(station_key(name, "alive")))
        publishers = {name: publisher(peer, name, content[name][0].encoding) for name in names}
        asked = Inbox()
        for name in names:
            stack.enter_context(transport.declare_queryable(station_key(name, "replay"), asked))
        threading.Thread(target=replay, args=(asked, content), daemon=True).start()
        for name in names:
            opened(transport, name, opening)
        put_at: dict[str, list[float]] = {name: [] for name in names}
        plan = sorted(
            ((seq + 1) * BATCH_S + spread_s * place / len(names), name, batch)
            for place, name in enumerate(names)
            for seq, batch in enumerate(content[name])
        )
        begun = time.monotonic() + 0.2
        reported.put(begun)
        for due, name, batch in plan:
            if (ahead := begun + due - time.monotonic()) > 0.0:
                time.sleep(ahead)
            publishers[name].put(batch.payload)
            put_at[name].append(time.monotonic())
        reported.put(put_at)
        over.wait(2.0 * CATCH_UP_S)  # the sessions stay open


def publisher(peer: Peer, name: str, encoding: str) -> zenoh.Publisher:
    """Of a station's samples."""
    return peer.network.declare_publisher(
        station_key(name, "samples"), encoding=encoding, congestion_control=zenoh.CongestionControl.DROP
    )


def replay(asked: Inbox, content: Mapping[str, Sequence[Encoded]]) -> None:
    """Send again what somebody missed, as a bridge does."""
    while True:
        question = asked.get(60.0)
        if question is None or isinstance(question, ReceivedSample | TokenChange):
            continue
        with question:
            wanted = parse_replay_parameters(question.parameters)
            station, _ = parse_station_key(question.key)
            for batch in content[station][wanted.first : wanted.last + 1][: wanted.limit]:
                question.reply(question.key, batch)


def prepared(task: str = TASKS[0], place: int = 0) -> tuple[list[Encoded], Encoded]:
    """Batches of ten seconds, from one of the PLACES of a recording on, and what opens a session."""
    recording = load_recording(DATA / f"{task}.npz")
    whole, rows = recording.matrix(), round(SECONDS / BATCH_S) * BATCH
    first = place * (len(whole) - rows) // (PLACES - 1)
    matrix = whole[first : first + rows].copy()
    matrix[:, 0] = whole[:rows, 0]
    batches = [
        encode(pack_samples(rows, recording.columns, session=SESSION, epoch=0, seq=seq))
        for seq, rows in enumerate(np.split(matrix, len(matrix) // BATCH))
    ]
    opening = Open(
        session=SESSION,
        columns=recording.columns,
        wrench_source=recording.wrench_source,
        force_frame=recording.force_frame,
        length_unit=recording.length_unit,
    )
    return batches, encode(Control(command=opening))


def opened(transport: ZenohTransport, name: str, opening: Encoded) -> None:
    """Open a session, once there is somebody to do it."""
    deadline = time.monotonic() + 30.0
    while time.monotonic() < deadline:
        answers = transport.query(station_key(name, "control"), opening)
        if answers.replies:
            decode(answers.replies[0].payload, answers.replies[0].encoding, Ack)
            return
        time.sleep(0.1)
    raise RuntimeError(f"nobody opened {name}")


def read(endpoint: str, stations: int, reported: Any) -> None:
    """Receive every result, look at it afterwards, and tell which came when."""
    arrived: list[tuple[float, zenoh.Sample]] = []
    with Peer(endpoint) as peer:
        subscriber = peer.network.declare_subscriber(
            session_key("*", "*", "posterior"), zenoh.handlers.FifoChannel(1 << 16)
        )
        reported.put("listening")
        threading.Thread(target=listen, args=(subscriber, arrived), daemon=True).start()
        end, known = time.monotonic() + 120.0, -1
        while time.monotonic() < end and (known < len(arrived) or not arrived):
            known = len(arrived)
            time.sleep(QUIET_S)
        subscriber.undeclare()
    found = []
    for at, sample in arrived:
        message = decode(sample.payload.to_bytes(), str(sample.encoding), Posterior)
        found.append((message.station, message.t, at))
    reported.put(found)


def listen(subscriber: Iterable[zenoh.Sample], arrived: list[tuple[float, zenoh.Sample]]) -> None:
    """Note what comes, and when."""
    for sample in subscriber:
        arrived.append((time.monotonic(), sample))


# --- what the service takes -----------------------------------------------------------------------------


def family(pid: int) -> list[int]:
    """A process and its children."""
    started = Path(f"/proc/{pid}/task").glob("*/children")  # by any of its threads
    children = [child for path in started for child in path.read_text().split()]
    return [pid, *(one for child in children for one in family(int(child)))]


def processor_s(pid: int) -> tuple[float, float]:
    """[s] of processor time so far of a process and its children: all threads, and the network's own."""
    whole = network = 0.0
    for path in (path for one in family(pid) for path in Path(f"/proc/{one}/task").glob("*/stat")):
        name, _, rest = path.read_text().partition("(")[2].rpartition(")")
        user, system = rest.split()[11:13]
        spent = (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")
        whole += spent
        network += spent * name.startswith(NETWORK_THREADS)
    return whole, network


def memory_mb(pid: int) -> float:
    """Resident [MB]."""
    pages = (int(Path(f"/proc/{one}/statm").read_text().split()[1]) for one in family(pid))
    return sum(pages) * os.sysconf("SC_PAGE_SIZE") / 1e6


if __name__ == "__main__":
    main()
