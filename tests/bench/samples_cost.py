"""What a query for samples costs: the first picture of an hour, zooms, and what a live station notices.

An hour is written to a journal directly. It is read as after a restart, without an overview and with the kept
one; a zoom is one of nine ranges. Then a service answers the same while a station is taught: the time between
two results of that station, before and during the queries.
Usage: python tests/bench/samples_cost.py [--rate 1000] [--seconds 3600] [--orientation]
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from caesura_clients import query
from caesura_clients.bridge import Bridge
from caesura_clients.bridge.sources.file import FileSource
from caesura_protocol.errors import CaesuraError
from caesura_protocol.keys import SampleRange, session_key
from caesura_protocol.transport.inbox import Inbox
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from caesura_service.decimation import SampleReader
from caesura_service.decimation.reader import Owned
from caesura_service.journal import FileBatches, SqliteJournal
from dashboard.stage import patient
from harness.journals import COLUMNS, TURNING_COLUMNS, ended, taught, turning, written
from harness.processes import ServiceProcess, running

BINS = 1200
QUIET_S, WARM_UP_S = 10.0, 4.0
OWNED = Owned("cell-1", "s1", "caesura-1", 1, is_open=False)


def timed(work: Callable[[], object]) -> float:
    """[s]"""
    began = time.monotonic()
    work()
    return time.monotonic() - began


def zooms(seconds: float) -> list[SampleRange]:
    """Ranges from half of the session to a three-hundredth."""
    starts = np.linspace(0.1, 0.4, 9) * seconds
    return [SampleRange(t0, t0 + seconds / 2**k, BINS) for k, t0 in enumerate(starts, 1)]


def read(folder: Path, seconds: float) -> None:
    """Print what the reader needs, in this process."""
    whole = SampleRange(0.0, seconds, BINS)
    with SqliteJournal(folder / "caesura-1.sqlite") as journal:
        reader = SampleReader(FileBatches(folder, journal))
        first = timed(lambda: reader.read(OWNED, whole))
    reader = SampleReader(FileBatches(folder))
    kept = timed(lambda: reader.read(OWNED, whole))
    took = [timed(lambda wanted=wanted: reader.read(OWNED, wanted)) for wanted in zooms(seconds)]
    print(f"first picture: read from the records {first:.2f} s, from the kept overview {kept:.3f} s")
    print(f"zoom: median {np.median(took):.3f} s, longest {max(took):.3f} s")


def beside(folder: Path, seconds: float) -> None:
    """Print how far apart the results of a live station are."""
    with (
        running(ServiceProcess(folder)) as service,
        ZenohTransport(service.endpoint) as robot,
        ZenohTransport(service.endpoint) as reader,
        Bridge(robot, "cell-2", FileSource(patient(), pace=1.0), session="live") as bridge,
    ):
        threading.Thread(target=teach, args=(bridge,), daemon=True).start()
        inbox, arrivals = Inbox(), list[float]()
        with reader.subscribe(session_key("cell-2", "live", "posterior"), inbox):
            began = time.monotonic()
            asking = threading.Thread(target=ask, args=(reader, seconds))
            while asking.ident is None or asking.is_alive():
                if inbox.get(0.2) is not None:
                    arrivals.append(time.monotonic())
                if asking.ident is None and time.monotonic() - began > WARM_UP_S + QUIET_S:
                    asked_at = time.monotonic()
                    asking.start()
        times = np.array(arrivals)
        for name, inside in (
            ("before", (times > began + WARM_UP_S) & (times < asked_at)),
            ("during", times > asked_at),
        ):
            gaps = 1000.0 * np.diff(times[inside])
            print(
                f"{name} the queries: {gaps.size} results, {np.median(gaps):.0f} ms apart (median), "
                f"99 % within {np.percentile(gaps, 99):.0f} ms, longest {gaps.max():.0f} ms"
            )


def teach(bridge: Bridge) -> None:
    """Until the other side is closed."""
    with suppress(CaesuraError):
        bridge.run()


def ask(reader: ZenohTransport, seconds: float) -> None:
    """The whole session, read from its records, then zooms."""
    for wanted in (SampleRange(0.0, seconds, BINS), *zooms(seconds)):
        query.samples(reader, "cell-1", "s1", wanted)


def main() -> None:
    """Print all of it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rate", type=float, default=1000.0, help="Hz")
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--orientation", action="store_true", help="four columns more, of a quaternion")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        journals = [Path(folder) / name for name in ("kept", "fresh")]
        make, columns = (turning, TURNING_COLUMNS) if asked.orientation else (taught, COLUMNS)
        matrix, closed = make(asked.seconds, asked.rate), ended("motion", t=asked.seconds)
        for one in journals:
            written(one, matrix, closed=closed, columns=columns)
        read(journals[0], asked.seconds)
        beside(journals[1], asked.seconds)


if __name__ == "__main__":
    main()
