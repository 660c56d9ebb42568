"""What a viewer of `caesura foxglove` receives of a long session, and what it costs the service's results.

A bridge sends ten minutes at 100 Hz over Zenoh to a real service, faster than real time, while a viewer that
speaks Foxglove's protocol receives every channel of the command. Exits 1 where a sample is missing, doubled,
changed or out of order. Then a station is taught in real time, in turns with the command beside it and
without: how long after its batch a result arrives. There the viewer has a process of its own, so that it does
not delay what measures. Differences have 95 % intervals, by a bootstrap over turns.
Usage: python tests/bench/foxglove_loss.py [--seconds 600] [--pace 20] [--turns 6]
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from multiprocessing import get_context
from multiprocessing.synchronize import Event
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from caesura_clients import Caesura, connect
from caesura_clients.bridge import Bridge
from caesura_clients.bridge.sources.file import FileSource
from caesura_protocol.codec import decode
from caesura_protocol.keys import session_key, station_key
from caesura_protocol.messages import Heartbeat, Posterior, SampleBatch
from caesura_protocol.recording import Recording
from caesura_protocol.transport.inbox import Inbox, ReceivedSample
from harness.demonstrations import RATE_HZ, taught
from harness.foxglove import Viewer, viewing
from harness.processes import CAESURA, QUICK, eventually, serving, started

STATION, EVERY, TURN_S, WARM_UP_S = "cell-1", 2, 20.0, 3.0  # every second sample of 200 Hz
RESAMPLES = 2000


def recording(seconds: float) -> Recording:
    """A demonstration at 100 Hz."""
    whole = taught(1, seconds)
    signals = {name: values[::EVERY] for name, values in whole.signals.items()}
    return Recording(whole.t[::EVERY], signals, wrench_source=whole.wrench_source, name="long")


@contextmanager
def foxglove(endpoint: str) -> Iterator[int]:
    """The command; the port on which it listens."""
    options = ("--station", STATION, "--port", "0", "--connect", endpoint)
    with started([*CAESURA, "foxglove", *options], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        yield int(process.stdout.readline().split("ws://127.0.0.1:")[1].split(";")[0])


@contextmanager
def viewed(endpoint: str) -> Iterator[None]:
    """The command, and the process of a viewer that has subscribed to all of it."""
    context = get_context("spawn")
    subscribed = context.Event()
    with foxglove(endpoint) as port:
        process = context.Process(target=view, args=(port, subscribed), daemon=True)
        process.start()
        try:
            assert subscribed.wait(30.0)
            yield
        finally:
            process.kill()
            process.join()


def view(port: int, subscribed: Event) -> None:
    """Receive until the process is killed."""
    with viewing(port) as viewer:
        assert viewer.subscribed.wait(30.0)
        subscribed.set()
        threading.Event().wait()


def wrong(sent: Recording, viewer: Viewer) -> list[str]:
    """What the viewer received otherwise than it was sent."""
    states, wrenches = viewer.of("/state"), viewer.of("/wrench")
    pairs = (
        ("/state t", [one["t"] for one in states], sent.t),
        ("/state pos", [one["pos"] for one in states], sent.signals["pos"]),
        ("/wrench t", [one["t"] for one in wrenches], sent.t),
        ("/wrench force", [one["force"] for one in wrenches], sent.signals["force"]),
    )
    return [
        f"{name}: {len(found)} of {len(of)}" for name, found, of in pairs if not np.array_equal(found, of)
    ]


def loss(caesura: Caesura, endpoint: str, seconds: float, pace: float) -> bool:
    sent = recording(seconds)
    with foxglove(endpoint) as port, viewing(port) as viewer:
        assert viewer.subscribed.wait(30.0)
        began = time.monotonic()
        with Bridge(
            caesura.transport, STATION, FileSource(sent, pace=pace), session="long", settings=QUICK
        ) as bridge:
            bridge.run()
        eventually(lambda: viewer.count("/wrench") >= sent.t.size)
        took = time.monotonic() - began
        found = wrong(sent, viewer)
        channels = len(viewer.schemas)
    print(f"{sent.t.size} samples ({seconds:.0f} s at {RATE_HZ / EVERY:.0f} Hz) in {took:.1f} s: ", end="")
    print("; ".join(found) or f"every one received, in order, bit for bit; {channels} channels")
    return not found


def lags(caesura: Caesura, session: str) -> list[float]:
    """[ms] from the arrival of the newest batch at a subscriber to that of the posterior which it completes.

    A batch comes each 0.1 s. From its samples on, the delay would be that of waiting for the next batch.
    """
    inbox, received, found = Inbox(), np.inf, list[float]()
    source = FileSource(recording(TURN_S), pace=1.0)
    with (
        caesura.transport.subscribe(station_key(STATION, "samples"), inbox),
        caesura.transport.subscribe(session_key(STATION, session, "posterior"), inbox),
        Bridge(caesura.transport, STATION, source, session=session, settings=QUICK) as bridge,
        ThreadPoolExecutor(1) as pool,
    ):
        over = pool.submit(bridge.run)
        while not over.done():
            item = inbox.get(0.1)
            if not isinstance(item, ReceivedSample):
                continue
            now = time.monotonic()
            message = decode(item.payload, item.encoding, SampleBatch, Heartbeat, Posterior)
            if isinstance(message, SampleBatch):
                received = now
            elif isinstance(message, Posterior) and message.t > WARM_UP_S and received < now:
                found.append(1e3 * (now - received))
    return found


def delay(caesura: Caesura, endpoint: str, turns: int) -> None:
    """Print the delay of results with the command and without it, in turns."""
    without, beside = list[list[float]](), list[list[float]]()
    for turn in range(turns):
        with viewed(endpoint) if turn % 2 else nullcontext():
            (beside if turn % 2 else without).append(lags(caesura, f"turn-{turn}"))
    for name, own in (("without a viewer", without), ("beside a viewer", beside)):
        half, most = percentiles(own)
        print(f"{name}: {sum(map(len, own))} results, delay {half:.2f} ms (median), {most:.2f} ms (99 %)")
    rng = np.random.default_rng(1)
    more = [resampled(beside, rng) - resampled(without, rng) for _ in range(RESAMPLES)]
    (half, most), bounds = (
        percentiles(beside) - percentiles(without),
        np.percentile(more, (2.5, 97.5), axis=0),
    )
    print(
        f"beside a viewer later by {half:+.2f} ({bounds[0, 0]:+.2f} to {bounds[1, 0]:+.2f}) ms (median), ",
        end="",
    )
    print(f"{most:+.2f} ({bounds[0, 1]:+.2f} to {bounds[1, 1]:+.2f}) ms (99 %)")


def resampled(turns: Sequence[Sequence[float]], rng: np.random.Generator) -> np.ndarray:
    """Return the percentiles of as many turns, drawn with replacement."""
    return percentiles([turns[index] for index in rng.integers(len(turns), size=len(turns))])


def percentiles(turns: Sequence[Sequence[float]]) -> np.ndarray:
    """Return the median and the 99 % quantile (2,) [ms] of all turns."""
    return np.percentile(np.concatenate(turns), (50.0, 99.0))


def main() -> None:
    """Print both, and exit 1 where a sample was lost."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=600.0, help="of the long session")
    parser.add_argument("--pace", type=float, default=20.0, help="of the long session, times real time")
    parser.add_argument("--turns", type=int, default=6, help=f"of {TURN_S:.0f} s each; 0 leaves them out")
    asked = parser.parse_args()
    with (
        tempfile.TemporaryDirectory() as folder,
        serving(Path(folder)) as service,
        connect(service.endpoint) as caesura,
    ):
        is_whole = loss(caesura, service.endpoint, asked.seconds, asked.pace)
        if asked.turns:
            delay(caesura, service.endpoint, asked.turns)
    sys.exit(not is_whole)


if __name__ == "__main__":
    main()
