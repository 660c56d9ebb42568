"""Where a service's time goes: µs of processor time a batch of 20 samples, part by part.

What a service does with a batch of a 1 kHz robot, from the payload to the results' payloads, many stations in
turn, with the real journal and the real mathematics. The network, its threads and the thread in
which the journal writes are not in it: `service_load.py` has the whole. A part's time is without that of
parts within it. Varied: stations teach five tasks, begun at five places, as in `service_load.py`.
Usage: python tests/bench/batch_cost.py [--stations N] [--varied] [--json DIR]
"""

from __future__ import annotations

import tempfile
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any
from unittest import mock

from machine import options, report
from service_load import PLACES, TASKS, prepared

from caesura_protocol.codec import Encoded, decode
from caesura_protocol.fragments import fragment
from caesura_protocol.keys import station_key
from caesura_protocol.messages import Control, Message
from caesura_service.app import segmenting_pipeline
from caesura_service.changepoint.compiled_filter import CompiledRunLengthFilter
from caesura_service.coaching import BoundaryCoach, SignalCoach
from caesura_service.journal import SqliteJournal
from caesura_service.monitoring.instrumented_registry import InstrumentedRegistry
from caesura_service.monitoring.session_event_logger import SessionEventLogger
from caesura_service.monitoring.station_counters import StationCounterSet
from caesura_service.publishing import state_updates
from caesura_service.publishing.events import Output, Owner, Publish
from caesura_service.segmentation.pipeline import SegmentationPipeline
from caesura_service.segmentation.segmenter import Segmenter
from caesura_service.server import worker
from caesura_service.server.batch_collector import BatchCollector
from caesura_service.server.inbound_events import RawPayload
from caesura_service.server.outbound import key_of
from caesura_service.sessions import batch_receiver
from caesura_service.sessions.limits import Limits
from caesura_service.sessions.same_layout_batches import ENCODING, BatchBlock
from caesura_service.signals import Conditioner

WARM_UP = 100  # batches of each station
BATCH_S, BATCHES_PER_S = 0.02, 50

#: Part → where its functions are looked up.
PARTS: Mapping[str, tuple[tuple[Any, str], ...]] = {
    "holding it": ((BatchCollector, "hold"), (BatchCollector, "take")),
    "reading the message": ((worker, "_batch"),),
    "checking its samples": (
        (batch_receiver, "validated_samples"),
        (batch_receiver, "is_usual"),
        (BatchBlock, "samples"),
    ),
    "handing it to the journal": ((SqliteJournal, "append"), (SqliteJournal, "append_batch")),
    "conditioning": ((Conditioner, "push"),),
    "a step of the filter": ((CompiledRunLengthFilter, "step"),),
    "segments and changepoints": ((Segmenter, "look"), (Segmenter, "outline")),
    "the program": ((SegmentationPipeline, "_apps"),),
    "phases": ((SegmentationPipeline, "_phases_with"),),
    "hints": ((SignalCoach, "observe"), (BoundaryCoach, "observe")),
    "what has changed, as messages": ((state_updates, "apply_view"), (state_updates, "update_program")),
    "counting and logging": (
        (StationCounterSet, "count_call"),
        (StationCounterSet, "count_batch"),
        (SessionEventLogger, "log_call"),
    ),
}
REST = "order, standing, all else"


class PartTimer:
    """Times parts by their own share."""

    def __init__(self) -> None:
        self.spent: Counter[str] = Counter()  # [s]
        self._within = [0.0]  # [s] what parts within took, of each part that is under way

    def timed(self, part: str, work: Callable[..., Any]) -> Callable[..., Any]:
        """The same work, told to the clock."""

        def timed(*args: Any, **kwargs: Any) -> Any:
            self._within.append(0.0)
            began = time.thread_time()
            try:
                return work(*args, **kwargs)
            finally:
                took = time.thread_time() - began
                self.spent[part] += took - self._within.pop()
                self._within[-1] += took

        return timed


def main() -> None:
    """Let all stations teach at once."""
    parser = options(__doc__)
    parser.add_argument("--stations", type=int, default=32)
    parser.add_argument("--varied", action="store_true")
    asked = parser.parse_args()
    taught = [prepared(*one) for one in (product(TASKS, range(PLACES)) if asked.varied else [(TASKS[0], 0)])]
    opening = taught[0][1]
    command = decode(opening.payload, opening.encoding, Control).command
    clock = PartTimer()
    with tempfile.TemporaryDirectory() as directory, ExitStack() as stack:
        registry = InstrumentedRegistry(
            owner=Owner("bench", 1),
            pipeline_factory=segmenting_pipeline(),
            default_preset="default",
            journal=stack.enter_context(SqliteJournal(Path(directory) / "journal.sqlite")),
            limits=Limits(),
        )
        names = [f"cell-{number}" for number in range(1, asked.stations + 1)]
        for name in names:
            registry.handle_command(name, command, 0.0)
        for part, places in PARTS.items():
            for owner, name in places:
                timed = clock.timed(part, getattr(owner, name))
                stack.enter_context(mock.patch.object(owner, name, timed))
        way = BatchPath(registry, clock.timed("writing messages", lambda message: list(fragment(message))))
        whole = clock.timed(REST, way.take)
        for seq, batches in enumerate(zip(*(content for content, _ in taught), strict=True)):
            if seq == WARM_UP:
                clock.spent.clear()
            for place, name in enumerate(names):
                whole(name, batches[place % len(batches)], seq * BATCH_S)
    count = (len(taught[0][0]) - WARM_UP) * len(names)
    show(clock.spent, count, asked.stations, asked.json)


class BatchPath:
    """What the threads of the service do with a batch, except for the network's and the journal's."""

    def __init__(self, registry: InstrumentedRegistry, write: Callable[[Message], object]) -> None:
        self._registry, self._write, self._now = registry, write, 0.0
        self._passed: list[Callable[[], None]] = []  # to be processed, as the queue has it
        self._collector = BatchCollector(
            registry.awaited,
            lambda *given: self._passed.append(partial(self._one, *given)),
            lambda *given: self._passed.append(partial(self._block, *given)),
            lambda: self._now,
        )

    def take(self, station: str, batch: Encoded, now: float) -> None:
        """Hold it, or process it with those that were held."""
        self._now, key = now, station_key(station, "samples")
        if not self._collector.hold(key, batch.payload, batch.encoding):
            self._collector.receive(RawPayload.of(key, batch.payload, batch.encoding), key, station)
        while self._passed:
            self._passed.pop()()

    def _one(self, content: RawPayload, source: str, station: str | None) -> None:
        assert station is not None
        self._publish(self._registry.handle_samples(station, worker._batch(content), self._now))

    def _block(self, block: BatchBlock, source: str, station: str) -> None:
        while block.payloads:
            count, outputs = self._registry.handle_together(station, block, self._now)
            if not count:
                self._one(RawPayload.of(source, block.payloads[0], ENCODING), source, station)
            self._publish(outputs)
            self._publish(self._registry.make_due_program(station, block.session))
            block = block.after(max(count, 1))

    def _publish(self, outputs: Sequence[Output]) -> None:
        for output in outputs:
            if isinstance(output, Publish):
                key_of(output.message)
                self._write(output.message)


def show(spent: Mapping[str, float], count: int, stations: int, directory: Path | None) -> None:
    """Largest first."""
    total = sum(spent.values())
    rows: list[Sequence[object]] = [
        (part, 1e6 * s / count, 100.0 * s / total) for part, s in sorted(spent.items(), key=lambda x: -x[1])
    ]
    share = 100.0 * BATCHES_PER_S * total / count
    rows.append((f"all of it: {share:.2f} % of a core a station", 1e6 * total / count, 100.0))
    report("batch_cost", f"{stations} stations", ("part", "µs a batch", "%"), rows, directory)


if __name__ == "__main__":
    main()
