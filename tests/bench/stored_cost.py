"""What a page of stored sessions costs, by the number of sessions in the journal.

Short closed sessions of 20 stations are written to a journal. A service without a network has it. A reader
asks for a page of all stations, of one station, from the middle on, and for one session by its name.

Usage: python tests/bench/stored_cost.py [--sessions 1000 20000] [--rounds 9] [--json DIR]
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import machine

sys.path.insert(0, str(Path(__file__).parents[1]))

from caesura_clients import query
from caesura_protocol.transport.memory import MemoryNetwork
from caesura_service.app import Service
from caesura_service.config import ServiceConfig
from caesura_service.server.memory_network import in_memory
from harness.fake_pipeline import make_fake_pipeline
from harness.journals import write_short_sessions

STATIONS = [f"cell-{number}" for number in range(20)]


def costs(sessions: int, rounds: int) -> Mapping[str, float]:
    """Return the median time [ms] of each query, beside a journal of so many sessions."""
    network = MemoryNetwork()
    with tempfile.TemporaryDirectory() as name:
        taught = [(STATIONS[number % len(STATIONS)], f"s{number:05d}") for number in range(sessions)]
        write_short_sessions(Path(name), taught)
        config = ServiceConfig(instance="caesura-1", preset="fake", journal=Path(name))
        with Service(config, pipeline_factory=make_fake_pipeline, join=in_memory(network)):
            ask = partial(query.stored_snapshots, network.transport())
            queries: Mapping[str, Callable[[], object]] = {
                "all stations": ask,
                "all stations, from the middle": partial(ask, skip=sessions // 2),
                "all stations, past the end": partial(ask, skip=sessions),
                "one station": partial(ask, "cell-7"),
                "one station, from the middle": partial(ask, "cell-7", skip=sessions // len(STATIONS) // 2),
                "the oldest session of a station": partial(ask, "cell-0", "s00000"),
                "the oldest session, by its name": partial(ask, "*", "s00000"),
                "a name that no session has": partial(ask, "*", "none"),
            }
            took = machine.in_turn(*queries.values(), rounds=rounds)
    return {name: 1e3 * taken for name, taken in zip(queries, took, strict=True)}


def main() -> None:
    """Measure, and print a row for each query."""
    parser = machine.options(__doc__)
    parser.add_argument("--sessions", type=int, nargs="+", default=[1000, 20000])
    parser.add_argument("--rounds", type=int, default=9)
    options = parser.parse_args()
    measured = [costs(sessions, options.rounds) for sessions in options.sessions]
    columns = ["query", *(f"beside {sessions} [ms]" for sessions in options.sessions)]
    rows = [[query, *(costs[query] for costs in measured)] for query in measured[0]]
    machine.report("stored_cost", "A page of stored sessions", columns, rows, options.json)


if __name__ == "__main__":
    main()
