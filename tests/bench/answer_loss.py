"""How many long answers Zenoh loses on a machine under load, by how the asker wants them sent.

A router answers queries with so many bytes. Counted are answers that came, queries that ended without one,
and queries that ended at their timeout. With DROP, which all clients ask with, Zenoh drops a piece of an
answer where its queue towards the asker stays full, and with it the end of the query. --batches: of 64 KiB in
that queue; a service has 16, and Zenoh by itself 2.
Prints; asserts nothing. The load is that of the machine, or of --hogs processes.
Usage: python tests/bench/answer_loss.py [--kib 4 250 900] [--queries 300] [--hogs 0] [--batches 16]
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
import time
from contextlib import closing
from multiprocessing.synchronize import Event
from pathlib import Path

import zenoh

sys.path.insert(0, str(Path(__file__).parents[1]))

from caesura_protocol.transport.zenoh_transport import SETTINGS
from caesura_service.security.zenoh_files import QUEUED_BATCHES
from clients.conftest import free_port

TIMEOUT_S = 2.0
CONTROLS = {"DROP": zenoh.CongestionControl.DROP, "BLOCK": zenoh.CongestionControl.BLOCK}


def session(**own: object) -> zenoh.Session:
    """A session of Zenoh as Caesura opens it, with its own settings."""
    config = zenoh.Config()
    for key, value in {**SETTINGS, **own}.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def answer(port: int, sizes: list[int], batches: int, ready: Event) -> None:
    """Answer queries for `answer/SIZE` with so many bytes."""
    own = {"mode": "router", "listen/endpoints": [f"tcp/127.0.0.1:{port}"]}
    router = session(**own, **{"transport/link/tx/queue/size/data": batches})

    def reply(query: zenoh.Query) -> None:
        with query:
            query.reply(str(query.key_expr), bytes(int(str(query.key_expr).rpartition("/")[2])))

    _held = [router.declare_queryable(f"answer/{size}", reply) for size in sizes]
    ready.set()
    time.sleep(3600.0)


def burn() -> None:
    """Use a processor."""
    while True:
        pass


def count(asker: zenoh.Session, size: int, control: str, queries: int) -> str:
    """Ask so often, and say what came."""
    found = {"answered": 0, "ended without an answer": 0, "timed out": 0}
    for _ in range(queries):
        began = time.monotonic()
        replies = asker.get(f"answer/{size}", timeout=TIMEOUT_S, congestion_control=CONTROLS[control])
        if any(reply.ok is not None for reply in replies):
            found["answered"] += 1
        else:
            is_late = time.monotonic() - began > 0.9 * TIMEOUT_S
            found["timed out" if is_late else "ended without an answer"] += 1
    return ", ".join(f"{number} {what}" for what, number in found.items())


def main() -> None:
    """Print a row for each size and control."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kib", type=int, nargs="+", default=[4, 250, 900])
    parser.add_argument("--queries", type=int, default=300)
    parser.add_argument("--hogs", type=int, default=0)
    parser.add_argument("--batches", type=int, default=QUEUED_BATCHES)
    asked = parser.parse_args()
    port, ready = free_port(), multiprocessing.Event()
    sizes = [1024 * kib for kib in asked.kib]
    works = [(answer, (port, sizes, asked.batches, ready)), *[(burn, ())] * asked.hogs]
    for work, arguments in works:
        multiprocessing.Process(target=work, args=arguments, daemon=True).start()
    ready.wait()
    with closing(session(**{"mode": "client", "connect/endpoints": [f"tcp/127.0.0.1:{port}"]})) as asker:
        for kib in asked.kib:
            for control in CONTROLS:
                print(f"{kib} KiB, {control}: {count(asker, 1024 * kib, control, asked.queries)}", flush=True)
    print(f"load of the machine: {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
