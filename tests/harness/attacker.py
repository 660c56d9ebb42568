"""A station that does as much as it can, in a process of its own: `python -m harness.attacker HOW ENDPOINT`.

`dense`: batches of 1000 samples that span a minute each, as fast as they go. `edits`: a session of an hour,
and 200 edits of it a second, each with the revision that the one before it will have made. `queries`: such a
session, and 1900 queries for its program a second. `tokens`: its token is declared and undeclared as fast as
it goes. `messages`: heartbeats; `commands`: closes of a session that is not there. `program_edits`: a session
of a minute, whose program has as many edits but one as it may have, and edits that do not apply, four at a
time. `listings`: eight readers list stored sessions, each with LISTINGS queries under way: all, those of a
station, by a costly filter, deep pages. Prints `ready` as soon as its session is there; the attack lasts
until it is ended. Then it prints what it has counted.
"""

from __future__ import annotations

import json
import signal
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import partial
from itertools import count as count_up
from itertools import cycle

import numpy as np
import zenoh

from caesura_protocol.codec import decode, decode_error, encode, pack_samples
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import (
    MAX_STORED,
    StoredPage,
    parse_replay_parameters,
    station_key,
    stored_parameters,
)
from caesura_protocol.messages import (
    MAX_BATCH_SAMPLES,
    MAX_PROGRAM_EDITS,
    Ack,
    AppReference,
    ChangeApp,
    Close,
    Control,
    Edit,
    EditProgram,
    Heartbeat,
    Insert,
    InsertApp,
    Open,
    Program,
    SampleBatch,
)
from harness.demonstrations import taught
from harness.peer import Peer
from harness.processes import DEADLINE_S, Process

STATION, SESSION = "hostile", "attack"
EVERY_S = 0.059  # from one sample to the next: a batch spans a minute
HOUR_S = 3420.0
EDITS_PER_S = 200.0
QUERIES_PER_S = 1900.0
MESSAGES_PER_S, COMMANDS_PER_S = 20_000.0, 5_000.0
PROGRAM_EDITS_PER_S, IN_FLIGHT = 1000.0, 4
MINUTE_S, OFF_S = 60.0, 0.05
READERS, LISTINGS = 8, 128
STORING, STORED = 8, 5000  # stations with stored sessions, and their sessions
PATIENCE_S = 60.0
SHORT = Open(session=SESSION, columns=("t", "px", "py", "pz"), wrench_source="none")


class Attacker(Process):
    """The same, as a process to be started and ended."""

    def __init__(self, how: str, endpoint: str) -> None:
        super().__init__([sys.executable, "-m", "harness.attacker", how, endpoint])

    def report(self) -> Counter[str]:
        """End it; how much it did. Empty where it had ended before."""
        assert self._process is not None
        was_alive = self._process.poll() is None
        self._process.terminate()
        said, _ = self._process.communicate(timeout=DEADLINE_S + PATIENCE_S)
        return Counter(json.loads(said.splitlines()[-1])) if was_alive and said else Counter()


def dense(peer: Peer, done: Counter[str]) -> None:
    """Batches whose every sample is an observation and more."""
    columns, rng = ("t", "px", "py", "pz"), np.random.default_rng(0)
    t = EVERY_S * np.arange(MAX_BATCH_SAMPLES)
    rows = np.column_stack([t, np.sin(t)[:, None] + 0.01 * rng.standard_normal((len(t), 3))])
    made = pack_samples(rows, columns, session=SESSION, epoch=0, seq=0)

    def batch(seq: int) -> SampleBatch:
        return made.model_copy(update={"seq": seq, "t0": seq * EVERY_S * MAX_BATCH_SAMPLES})

    opening = Open(
        session=SESSION,
        columns=columns,
        wrench_source="none",
        preset="constant_velocity",
        declared_units=("length",),  # or its speed is refused, which costs nobody anything
    )
    until_accepted(lambda: peer.command(opening, STATION))
    peer.network.declare_queryable(station_key(STATION, "replay"), lambda query: replay(query, batch))
    print("ready", flush=True)
    seq = 0
    while True:
        payload, encoding = encode(batch(seq))
        peer.network.put(station_key(STATION, "samples"), payload, encoding=encoding)
        seq += 1
        done["put"] = seq
        time.sleep(0.001)


def replay(query: zenoh.Query, batch: Callable[[int], SampleBatch]) -> None:
    """Whatever the service asks for again."""
    with query:
        wanted = parse_replay_parameters(str(query.parameters))
        for seq in range(wanted.first, min(wanted.last + 1, wanted.first + wanted.limit)):
            payload, encoding = encode(batch(seq))
            query.reply(station_key(STATION, "replay"), payload, encoding=encoding)


def hour(peer: Peer) -> None:
    """An hour is taught, in batches of a minute."""
    whole = taught(9, HOUR_S)
    columns = whole.columns
    rows = whole.matrix()[:: round(EVERY_S * 200.0)]
    opening = Open(session=SESSION, columns=columns, wrench_source="flange_sensor")
    until_accepted(lambda: peer.command(opening, STATION))
    parts = np.array_split(rows, -(-len(rows) // MAX_BATCH_SAMPLES))
    for seq, part in enumerate(parts):
        peer.send(pack_samples(part, columns, session=SESSION, epoch=0, seq=seq), STATION)
    until_accepted(lambda: all_taken(peer.command(opening, STATION), len(parts)))
    print("ready", flush=True)


def again_and_again(act: Callable[[], object], per_s: float) -> None:
    """Never returns."""
    began, made = time.monotonic(), 0
    while True:
        act()
        made += 1
        time.sleep(max(0.0, began + made / per_s - time.monotonic()))


def edits(peer: Peer, done: Counter[str]) -> None:
    """An hour is edited, until the end of the attack and until the first edit is carried out."""
    hour(peer)
    storm = Storm(peer, done)
    try:
        again_and_again(storm.edit, EDITS_PER_S)
    finally:
        storm.accepted.wait(PATIENCE_S)


def program_edits(peer: Peer, done: Counter[str]) -> None:
    """A program that has all edits but one is edited; each edit is refused, for its app is not there."""
    minute(peer)
    program = peer.ask(station_key(STATION, "program"), Program)[station_key(STATION, "program")]
    for action in costly_edits(program):
        edit = EditProgram(session=SESSION, revision=done["made"], author="attacker", action=action)
        until_accepted(partial(peer.control, *encode(Control(command=edit)), STATION))
        done["made"] += 1
    gone = ChangeApp(app=AppReference(kind="hold", t0=-5.0, tn=1e9), note="gone")
    refused = EditProgram(session=SESSION, revision=done["made"], author="attacker", action=gone)
    payload, encoding = encode(Control(command=refused))
    turns = threading.Semaphore(IN_FLIGHT)

    def count(reply: zenoh.Reply) -> None:
        if reply.ok is None:
            done[decode_error(reply.err.payload.to_bytes(), str(reply.err.encoding)).code] += 1
        turns.release()

    def ask() -> None:
        turns.acquire(timeout=PATIENCE_S)
        done["put"] += 1
        key, counted = station_key(STATION, "control"), zenoh.handlers.Callback(count, indirect=False)
        peer.network.get(key, counted, payload=payload, encoding=encoding, timeout=PATIENCE_S)

    print("ready", flush=True)
    again_and_again(ask, PROGRAM_EDITS_PER_S)


def minute(peer: Peer) -> None:
    """A minute is taught, and its session is closed."""
    whole = taught(9, MINUTE_S)
    columns, rows = whole.columns, whole.matrix()
    opening = Open(session=SESSION, columns=columns, wrench_source="flange_sensor")
    until_accepted(lambda: peer.command(opening, STATION))
    parts = np.array_split(rows, -(-len(rows) // MAX_BATCH_SAMPLES))
    for seq, part in enumerate(parts):
        peer.send(pack_samples(part, columns, session=SESSION, epoch=0, seq=seq), STATION)
    closing = Close(session=SESSION, last_seq=len(parts) - 1)
    until_accepted(lambda: peer.command(closing, STATION))


def costly_edits(program: Program) -> Iterator[InsertApp]:
    """All edits but one that a program may have: apps of ten minutes behind one app.

    The last third of them names it by a time that is near: it may be any app of about that time.
    """
    app = next(one for one in program.apps if one.kind in ("cartesian_motion", "move_to_contact"))
    for number in range(MAX_PROGRAM_EDITS - 1):
        off_s = OFF_S if number > MAX_PROGRAM_EDITS * 2 // 3 else 0.0
        near = AppReference(kind=app.kind, t0=app.t0 + off_s, tn=app.tn + off_s)
        yield InsertApp(after=near, kind="cartesian_motion", seconds=600.0, target=(0.4, 0.0, 0.3))


def queries(peer: Peer, done: Counter[str]) -> None:
    """The program of an hour is asked for. A query that ends without an answer counts as put alone."""
    hour(peer)
    key = station_key(STATION, "program")

    def count(reply: zenoh.Reply) -> None:
        done["answered" if reply.ok is not None else "refused"] += 1

    def ask() -> None:
        done["put"] += 1
        peer.network.get(key, zenoh.handlers.Callback(count, indirect=False), timeout=PATIENCE_S)

    again_and_again(ask, QUERIES_PER_S)


def tokens(peer: Peer, done: Counter[str]) -> None:
    """Its token comes and goes."""
    print("ready", flush=True)
    while True:
        peer.network.liveliness().declare_token(station_key(STATION, "alive")).undeclare()
        done["put"] += 1


def all_taken(ack: Ack, batches: int) -> None:
    if ack.next_seq < batches:
        raise ProtocolError("overloaded", "not there yet")


def until_accepted(ask: Callable[[], object]) -> None:
    """Ask until it is not refused."""
    deadline = time.monotonic() + PATIENCE_S
    while True:
        try:
            ask()
        except (ProtocolError, ValueError):
            assert time.monotonic() < deadline
            time.sleep(0.1)
        else:
            return


class Storm:
    """Edits that do not wait for an answer."""

    def __init__(self, peer: Peer, done: Counter[str]) -> None:
        self._peer = peer
        self._done = done
        self._revision = 0  # that the next edit will find, if all before it are carried out
        self._lock = threading.Lock()
        self.accepted = threading.Event()

    def edit(self) -> None:
        """One more."""
        with self._lock:
            revision, self._revision = self._revision, self._revision + 1
            self._done["put"] += 1
        action = Insert(t=HOUR_S / 2 + 0.3 * (revision % 100))
        command = Edit(session=SESSION, revision=revision, author="attacker", action=action)
        payload, encoding = encode(Control(command=command))
        self._peer.network.get(
            station_key(STATION, "control"),
            zenoh.handlers.Callback(self._take, indirect=False),
            payload=payload,
            encoding=encoding,
            timeout=PATIENCE_S,
        )

    def _take(self, reply: zenoh.Reply) -> None:
        """A refusal tells which revision there is."""
        if reply.ok is not None:
            decode(reply.ok.payload.to_bytes(), str(reply.ok.encoding), Ack)
            with self._lock:
                self._done["accepted"] += 1
            self.accepted.set()
            return
        try:
            refusal = decode_error(reply.err.payload.to_bytes(), str(reply.err.encoding))
        except ProtocolError:
            return
        with self._lock:
            self._done[refusal.code] += 1
            if refusal.code == "conflict" and isinstance(refusal.limit, int):
                self._revision = refusal.limit
            elif refusal.code == "overloaded":
                self._revision -= 1


def messages(peer: Peer, done: Counter[str]) -> None:
    """Heartbeats of a session, whose messages are as short as any."""
    until_accepted(lambda: peer.command(SHORT, STATION))
    payload, encoding = encode(Heartbeat(session=SESSION, epoch=0, seq=0))
    print("ready", flush=True)

    def put() -> None:
        peer.network.put(station_key(STATION, "samples"), payload, encoding=encoding)
        done["put"] += 1

    again_and_again(put, MESSAGES_PER_S)


def commands(peer: Peer, done: Counter[str]) -> None:
    """Closes of a session that is not there."""
    payload, encoding = encode(Control(command=Close(session="none", last_seq=3)))
    key, ignored = station_key(STATION, "control"), zenoh.handlers.Callback(lambda _: None, indirect=False)
    print("ready", flush=True)

    def ask() -> None:
        peer.network.get(key, ignored, payload=payload, encoding=encoding, timeout=PATIENCE_S)
        done["put"] += 1

    again_and_again(ask, COMMANDS_PER_S)


def listings(peer: Peer, done: Counter[str]) -> None:
    """The stored sessions are listed in the greatest pages. A query without a reply counts as put alone."""
    names = [f"stored-{number}" for number in range(STORING)]
    filters = cycle(
        [
            "caesura/v1/session/*/*/snapshot",
            *(f"caesura/v1/session/{name}/*/snapshot" for name in names),
            f"caesura/v1/session/*/{'$*0' * 40}/snapshot",
        ]
    )

    def count(turns: threading.Semaphore, reply: zenoh.Reply) -> None:
        done["answered" if reply.ok is not None else "refused"] += 1

    def flood(network: zenoh.Session) -> None:
        turns = threading.Semaphore(LISTINGS)
        for number in count_up():
            turns.acquire(timeout=PATIENCE_S)
            done["put"] += 1
            wanted = StoredPage(MAX_STORED, skip=(number * 997) % STORED)
            handler = zenoh.handlers.Callback(partial(count, turns), turns.release, indirect=False)
            network.get(f"{next(filters)}?{stored_parameters(wanted)}", handler, timeout=PATIENCE_S)

    print("ready", flush=True)
    with ExitStack() as stack:
        readers = [stack.enter_context(Peer(peer.endpoint)) for _ in range(READERS)]
        threads = [threading.Thread(target=flood, args=(one.network,), daemon=True) for one in readers]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()


WAYS = {
    "listings": listings,
    "dense": dense,
    "edits": edits,
    "queries": queries,
    "tokens": tokens,
    "messages": messages,
    "commands": commands,
    "program_edits": program_edits,
}


def main() -> None:
    how, endpoint = sys.argv[1:]
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())
    done = Counter[str]()
    try:
        with Peer(endpoint) as peer:
            WAYS[how](peer, done)
    finally:
        print(json.dumps(done), flush=True)


if __name__ == "__main__":
    main()
