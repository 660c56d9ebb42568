"""A station that does as much as it can, beside seven that are taught: nothing of theirs is lost or late.

A reader who asks about one of the seven gets an answer.
"""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from caesura_clients.query import service_status, snapshot
from caesura_protocol.errors import CaesuraError, ProtocolError
from caesura_protocol.keys import service_key, station_key
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from faults.suite.lateness import lateness_ms
from faults.suite.outcome import Disturbance, Row, Scale, played
from faults.suite.stations import CONNECT_S, TaughtStation, reached
from harness.attacker import SESSION, STATION, STORING, Attacker
from harness.journals import write_short_sessions
from harness.processes import Router, running, serving

HONEST = Scale(stations=7, pace=1.0)
LIMIT_MS = 100.0  # of the 99th percentile
LASTS = 0.9  # of the demonstrations
# What the attacker did at least, or it proves nothing: what it sent, and what the service did of it.
LEAST: Mapping[str, Mapping[str, int]] = {
    "dense": {"put": 4000, "observations": 5000},
    "edits": {"put": 2000, "accepted": 1, "overloaded": 1000},
    "program_edits": {"made": 499, "put": 2000, "conflict": 1000},
    "queries": {"put": 20000, "answered": 100},
    "tokens": {"put": 50000},
    "messages": {"put": 100_000},
    "commands": {"put": 25_000},
    "listings": {"put": 20_000, "answered": 100, "refused": 1000},
}
EVERY_S = 0.25  # between two queries about one of the seven
ANSWER_S = 1.0  # that an answer takes at most


@dataclass
class NeighbourAnswers:
    """The answers to a reader who asks about one of the seven."""

    took_s: list[float] = field(default_factory=list)  # [s]
    missing: list[str] = field(default_factory=list)  # why

    def are_prompt(self) -> bool:
        """Whether each came within ANSWER_S."""
        return bool(self.took_s) and not self.missing and max(self.took_s) < ANSWER_S

    def __str__(self) -> str:
        why = f" ({self.missing[0]})" if self.missing else ""
        most = max(self.took_s, default=0.0)
        asked = len(self.took_s) + len(self.missing)
        return f"{len(self.took_s)} of {asked} queries answered{why}, within {most:.2f} s"


def hostile_station(
    how: str, directory: Path, scale: Scale = HONEST, *, behind_router: bool = False, stored: int = 0
) -> Row:
    """`harness.attacker` for as long as the others are taught. stored: sessions in the journal before."""
    if stored:
        write_stored_sessions(directory, stored)
    did, answers = Counter[str](), NeighbourAnswers()

    def disturb(stations: list[TaughtStation], disturbance: Disturbance) -> None:
        with asking(service.endpoint, stations[0].name, answers):
            reached(stations, LASTS)
        with ZenohTransport(service.endpoint, timeout_s=CONNECT_S) as transport:
            (status,) = service_status(transport)
            did["observations"] = observations(transport)
        disturbance.note = f"{status.dropped} messages dropped, {status.refused} refused, none of theirs"

    with (
        running(Router()) if behind_router else nullcontext() as router,
        serving(directory, router=router and router.endpoint) as service,
        running(Attacker(how, service.endpoint)) as attacker,
    ):
        done = played(service.endpoint, directory, disturb, scale=scale)
        did += attacker.report()
        p50, p99, most = np.percentile(lateness_ms(done), [50, 99, 100])
        late = f"results {p50:.0f} ms late (median), {p99:.0f} ms (p99), {most:.0f} ms at most"
        did_least = all(did[what] >= least for what, least in LEAST[how].items())
        note = f"{late}; {answers}; it did {dict(did)}" + (
            "" if did_least else f", expected {dict(LEAST[how])}"
        )
        return done.row(note=note, met=bool(p99 < LIMIT_MS) and did_least and answers.are_prompt())


@contextmanager
def asking(endpoint: str, station: str, answers: NeighbourAnswers) -> Iterator[None]:
    """Ask for a station's program and the service's status while the context lasts."""
    over = threading.Event()

    def ask() -> None:
        with ZenohTransport(endpoint, timeout_s=CONNECT_S) as transport:
            while not over.wait(EVERY_S):
                for key in (station_key(station, "program"), service_key("*", "status")):
                    began = time.monotonic()
                    replies, refusals = transport.query(key)
                    if replies:
                        answers.took_s.append(time.monotonic() - began)
                    else:
                        answers.missing.append(str(next(iter(refusals), "no answer")))

    thread = threading.Thread(target=ask, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def write_stored_sessions(directory: Path, count: int) -> None:
    """Write the sessions that `listings` of the attacker asks for."""
    keys = [(f"stored-{number % STORING}", f"s{number:05d}") for number in range(count)]
    write_short_sessions(directory, keys, kinds=["motion", "steady"] * 15)


def observations(transport: ZenohTransport) -> int:
    """How many the service has made of what the attacker sent."""
    try:
        return snapshot(transport, STATION, SESSION).status.observations
    except (CaesuraError, ProtocolError):
        return 0
