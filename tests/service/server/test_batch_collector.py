"""Held until an observation is complete, and no longer; in order, and with the results of one by one."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from caesura_protocol.codec import decode, encode, pack_samples
from caesura_protocol.errors import ProtocolError
from caesura_protocol.formats.read import load_recording
from caesura_protocol.keys import station_key
from caesura_protocol.messages import (
    Close,
    Edit,
    Heartbeat,
    Insert,
    Message,
    Open,
    SampleBatch,
)
from caesura_service.app import segmenting_pipeline
from caesura_service.journal import JournalError, MemoryJournal, Record
from caesura_service.monitoring.instrumented_registry import InstrumentedRegistry
from caesura_service.publishing.events import Output
from caesura_service.publishing.session_state import snapshot_of
from caesura_service.server.batch_collector import HOLD_S, MISSES, MOST, SOURCES, BatchCollector
from caesura_service.server.inbound_events import RawPayload
from caesura_service.sessions.limits import Limits
from caesura_service.sessions.same_layout_batches import BatchBlock
from caesura_service.sessions.session import Awaited
from harness.sessions import NAME, OWNER, STATION

KEY = station_key(STATION, "samples")
COLUMNS = ("t", "px")


def rows_of(seq: int, *, batch_s: float = 0.02) -> NDArray[np.float64]:
    t = batch_s * seq + 0.001 * np.arange(20)
    return np.column_stack([t, np.sin(t)])


def payload_of(seq: int, *, session: str = NAME, **shape: float) -> bytes:
    return encode(pack_samples(rows_of(seq, **shape), COLUMNS, session=session, epoch=0, seq=seq)).payload


ENCODING = encode(pack_samples(rows_of(0), COLUMNS, session=NAME, epoch=0, seq=0)).encoding


class CollectorOfSession:
    """A collector before a session that has a due time, with what was passed on."""

    def __init__(self, due_s: float = 0.1) -> None:
        self.now, self.passed = 0.0, list[tuple[str, object]]()
        self.awaited: Awaited | None = Awaited(0, due_s)
        self.collector = BatchCollector(
            lambda station, session: self.awaited,
            lambda content, source, station: self.passed.append((source, content.payload)),
            lambda block, source, station: self.passed.append((source, numbers(block))),
            lambda: self.now,
        )

    def put(self, payload: bytes, key: str = KEY, encoding: str = ENCODING) -> None:
        """As the server does."""
        if not self.collector.hold(key, payload, encoding):
            self.collector.receive(RawPayload.of(key, payload, encoding), key, STATION)

    def blocks(self) -> list[object]:
        return [block for _, block in self.passed if isinstance(block, list)]


def numbers(block: BatchBlock) -> list[int]:
    return [*range(block.first, block.first + len(block.payloads))]


def test_batches_wait_for_the_one_that_completes_an_observation():
    floor = CollectorOfSession()
    for seq in range(18):
        floor.awaited = Awaited(seq, 0.1)  # all that was passed on is processed; the due time is the last one
        floor.put(payload_of(seq))
    assert floor.passed[0] == (KEY, payload_of(0)), "its layout is not known"
    # Samples reach 0.099 s with batch 4; batch 5 has 0.1 s. Then every five batches have an observation.
    assert floor.blocks()[0] == [1, 2, 3, 4, 5]


def test_while_earlier_ones_wait_to_be_processed_the_next_observation_is_predicted():
    floor = CollectorOfSession()
    floor.put(payload_of(0))
    floor.awaited = Awaited(1, 0.1)
    for seq in range(1, 18):
        floor.put(payload_of(seq))
    assert floor.blocks() == [[1, 2, 3, 4, 5], [6, 7, 8, 9, 10], [11, 12, 13, 14, 15]]


def test_in_a_backlog_batches_wait_together_though_no_due_time_is_known():
    floor = CollectorOfSession()  # the session has still to process the first batch
    for seq in range(20):
        floor.put(payload_of(seq))
    lengths = [len(block) for block in floor.blocks() if isinstance(block, list)]
    assert lengths[0] == 1
    assert all(4 <= count <= 6 for count in lengths[1:]), "five make an observation, but for a rounded time"
    assert sum(lengths) >= 16


def test_nothing_waits_longer_than_an_observation_takes():
    floor = CollectorOfSession(due_s=9.0)
    floor.put(payload_of(0))
    floor.awaited = Awaited(1, 9.0)
    floor.put(payload_of(1))
    floor.now = 0.5 * HOLD_S
    floor.put(payload_of(2))
    floor.collector.release_overdue()
    assert floor.blocks() == []
    floor.now = HOLD_S
    floor.collector.release_overdue()
    assert floor.blocks() == [[1, 2]]
    floor.collector.release_overdue()
    assert floor.blocks() == [[1, 2]]


def test_no_more_than_so_many_wait():
    floor = CollectorOfSession(due_s=1e6)
    floor.put(payload_of(0))
    floor.awaited = Awaited(1, 1e6)
    for seq in range(1, 2 * MOST + 3):
        floor.put(payload_of(seq))
    assert [len(block) for block in floor.blocks() if isinstance(block, list)] == [MOST, MOST]


@pytest.mark.parametrize(
    "other",
    [
        (b"rubbish", ENCODING),
        (payload_of(9), ENCODING),  # a hole
        (payload_of(1), ENCODING),  # once more
        (payload_of(3, session="s2"), ENCODING),
        tuple(encode(Heartbeat(session=NAME, epoch=0, seq=2))),
        (payload_of(3), "application/msgpack;caesura.SampleBatch.v2"),
    ],
)
def test_what_else_comes_of_a_station_finds_the_held_ones_passed_on(other):
    floor = CollectorOfSession(due_s=9.0)
    floor.put(payload_of(0))
    floor.awaited = Awaited(1, 9.0)
    floor.put(payload_of(1))
    floor.put(payload_of(2))
    floor.put(*other[:1], encoding=other[1])
    assert [each for _, each in floor.passed] == [payload_of(0), [1, 2], other[0]]


def test_a_command_releases_its_own_station_alone():
    floor = CollectorOfSession(due_s=9.0)
    there = station_key("cell-2", "samples")
    for key in (KEY, there):
        for seq in range(3):
            floor.awaited = Awaited(seq, 9.0)
            floor.put(payload_of(seq), key)
    floor.collector.release(KEY)
    assert [(key, block) for key, block in floor.passed if isinstance(block, list)] == [(KEY, [1, 2])]
    floor.collector.release_all()
    assert floor.passed[-1] == (there, [1, 2])


@pytest.mark.parametrize("awaited", [None, Awaited(1, float("-inf"))])
def test_where_no_session_states_a_due_time_nothing_waits(awaited):
    floor = CollectorOfSession()
    floor.put(payload_of(0))
    floor.awaited = awaited
    floor.put(payload_of(1))
    assert floor.blocks() == [[1]]


def test_senders_take_bounded_room_and_what_never_has_a_layout_is_seldom_looked_at(monkeypatch):
    floor, looked = CollectorOfSession(), list[bytes]()
    for number in range(SOURCES + 10):
        floor.put(payload_of(0), station_key(f"cell-{number}", "samples"))
    assert len(floor.collector._sources) <= SOURCES
    monkeypatch.setattr("caesura_service.server.batch_collector.BatchLayout.of", looked.append)
    for _ in range(100):
        floor.put(b"rubbish")
    assert MISSES <= len(looked) <= MISSES + 2


# --- as one by one --------------------------------------------------------------------------------------

Step = tuple[str, Any]
RECORDING = load_recording(Path(__file__).parents[3] / "data" / "pick_and_place.npz")  # at 1 kHz
MATRIX, NAMES = RECORDING.matrix()[:5000], RECORDING.columns
WHOLE = Open(session=NAME, columns=NAMES, wrench_source=RECORDING.wrench_source)


class Failing(MemoryJournal):
    """Cannot record some batches."""

    def __init__(self, failures: Iterable[int]) -> None:
        super().__init__()
        self._failures = {*failures}

    def append(self, record: Record, *, now: bool = False) -> None:
        """As others, unless it is one of those."""
        if isinstance(record.message, SampleBatch) and record.message.seq in self._failures:
            raise JournalError("no room")
        super().append(record, now=now)


class TalkativeRegistry:
    """A registry with the real mathematics, and all that it has said."""

    def __init__(self, failures: Iterable[int] = (), **limits: int) -> None:
        self.journal = Failing(failures)
        self.registry = InstrumentedRegistry(
            owner=OWNER,
            pipeline_factory=segmenting_pipeline(),
            default_preset="default",
            journal=self.journal,
            limits=Limits(**limits),
        )
        self.said = list[object]()
        self.do("command", WHOLE)

    def do(self, kind: str, what: Any) -> None:
        if kind == "command":
            self.receive(self.registry.handle_command(STATION, what, 0.0))
        elif kind == "tick":
            self.receive(self.registry.tick(what))
        else:
            self.samples(what)

    def samples(self, content: RawPayload) -> None:
        """As the worker does with one."""
        try:
            message = decode(content.payload, content.encoding, SampleBatch, Heartbeat)
        except ProtocolError as error:
            self.receive(self.registry.reject(STATION, error))
            return
        self.receive(self.registry.handle_samples(STATION, message, 0.0))

    def receive(self, outputs: Sequence[Output]) -> None:
        self.said += [plain(output) for output in outputs]

    def end(self) -> None:
        """Nothing is left to do."""

    def all_of_it(self) -> tuple[object, ...]:
        """What was said, is shown, is recorded and is counted."""
        states = self.registry.index.all_states()
        counted = self.registry.station_counters.of_station.get(STATION)
        assert counted is not None
        counted.received_s = None
        counters = self.registry.counters
        return (
            self.said,
            [snapshot_of(state) for state in states],
            [(state.counters, state.lifecycle) for state in states],
            [*self.journal.replay(STATION, NAME)],
            counted,
            (counters.refused, counters.last_refusal),
        )


class Together(TalkativeRegistry):
    """The same behind a collector, and behind a queue that is worked off now and then.

    late_s: by how much the collector is wrong about when an observation is complete.
    """

    def __init__(self, failures: Iterable[int], works: Sequence[bool], late_s: float, **limits: int) -> None:
        self._late_s = late_s
        self._queue: deque[tuple[str, Any]] = deque()
        self._works, self._now, self.together = deque(works), 0.0, 0
        super().__init__(failures, **limits)

    def do(self, kind: str, what: Any) -> None:
        if not hasattr(self, "_collector"):
            self._collector = BatchCollector(
                self._awaited,
                lambda content, source, station: self._queue.append(("samples", content)),
                lambda block, source, station: self._queue.append(("block", block)),
                lambda: self._now,
            )
        if kind == "samples":
            if not self._collector.hold(what.key, what.payload, what.encoding):
                self._collector.receive(what, what.key, STATION)
        else:
            self._collector.release(KEY)
            self._queue.append((kind, what))
        if kind == "tick":
            self._now += what
            self._collector.release_overdue()
        if not self._works or self._works.popleft():
            self.work()

    def _awaited(self, station: str, session: str) -> Awaited | None:
        found = self.registry.awaited(station, session)
        return found and found._replace(due_s=found.due_s + self._late_s)

    def work(self) -> None:
        """Work the queue off."""
        while self._queue:
            kind, what = self._queue.popleft()
            if kind != "block":
                super().do(kind, what)
                continue
            block: BatchBlock = what
            while block.payloads:
                count, outputs = self.registry.handle_together(STATION, block, 0.0)
                if count:
                    self.receive(outputs)
                    self.receive(self.registry.make_due_program(STATION, block.session))
                    self.together += count > 1
                else:
                    super().samples(RawPayload.of(KEY, block.payloads[0], ENCODING))
                block = block.after(max(count, 1))

    def end(self) -> None:
        self._collector.release_all()
        self.work()


def plain(output: Output) -> object:
    """A value that is equal for equal outputs; errors are compared by what they say."""
    error = getattr(output, "error", None) or getattr(output, "reply", None)
    return (type(output), repr(error)) if isinstance(error, Exception) else output


def message(made: Message) -> Step:
    payload, encoding = encode(made)
    return "samples", RawPayload.of(KEY, payload, encoding)


def stream(cuts: Sequence[int], disturbances: Mapping[int, str]) -> list[Step]:
    """A demonstration in batches of these sizes, of which some are disturbed."""
    made = Disturbed()
    for seq, size in enumerate(cuts):
        if made.first >= len(MATRIX):
            break
        made.add(seq, size, disturbances.get(seq, ""))
    return [*made.steps, ("command", Close(session=NAME, last_seq=seq))]


class Disturbed:
    """The steps of a stream."""

    def __init__(self) -> None:
        self.steps: list[Step] = []
        self.first, self._epoch, self._edits, self._moved_s = 0, 0, 0, 0.0
        self._late: list[Step] = []

    def add(self, seq: int, size: int, what: str) -> None:
        """A batch, what comes before it, and what becomes of it."""
        rows = MATRIX[self.first : self.first + size].copy()
        self.first += size
        self._moved_s += MOVES_S.get(what, 0.0)
        rows[:, 0] += self._moved_s
        self._spoil(rows, what)
        self.steps += self._before(seq, what)
        columns = NAMES[:-1] if what == "columns" else NAMES
        packed = pack_samples(
            rows[:, : len(columns)].astype(np.float32 if what == "single" else np.float64),
            columns,
            session=NAME,
            epoch=self._epoch,
            seq=seq,
            bridge="b-2" if what == "bridge" else None,
        )
        step = message(packed)
        if what == "late":
            self._late.append(step)
        elif what != "lost":
            self.steps += [step] * (1 + (what == "twice")) + self._late
            self._late = []

    def _spoil(self, rows: NDArray[np.float64], what: str) -> None:
        if what == "repeat":
            rows[1:, 0] = rows[:-1, 0].copy()
        elif what == "nan":
            rows[-1, 2] = np.nan
        elif what == "huge":
            rows[0, 3] = 1e9
        elif what == "impossible":
            rows[-1, NAMES.index("gripper")] = 7.0

    def _before(self, seq: int, what: str) -> list[Step]:
        self._epoch += what == "reopen"
        self._edits += what == "edit"
        insert = Edit(session=NAME, revision=max(self._edits - 1, 0), author="a", action=Insert(t=1.0))
        return {
            "reopen": [("command", WHOLE.model_copy(update={"epoch": self._epoch}))],
            "edit": [("command", insert)],
            "close": [("command", Close(session=NAME, last_seq=seq - 1))],
            "tick": [("tick", 0.06)],
            "beat": [message(Heartbeat(session=NAME, epoch=self._epoch, seq=seq - 1))],
            "early": [message(Heartbeat(session=NAME, epoch=self._epoch, seq=seq + 2))],
            "rubbish": [("samples", RawPayload.of(KEY, b"rubbish", ENCODING))],
        }.get(what, [])


MOVES_S = {"gap": 0.6, "leap": 1e5, "short": 0.05, "back": -0.1, "set": -2.0}
KINDS = (
    *("gap", "leap", "short", "back", "set", "repeat", "nan", "huge", "impossible", "single", "columns"),
    *("reopen", "edit", "tick", "beat", "early", "rubbish", "close", "bridge", "lost", "late", "twice"),
)


def compared(
    steps: Sequence[Step],
    failures: Iterable[int] = (),
    works: Sequence[bool] = (),
    late_s: float = 0.0,
    **limits: int,
) -> int:
    """How often some were processed together, with all as if they had been processed one by one."""
    each, together = TalkativeRegistry(failures, **limits), Together(failures, works, late_s, **limits)
    for step in steps:
        each.do(*step)
        together.do(*step)
    together.end()
    for there, here in zip(each.all_of_it(), together.all_of_it(), strict=True):
        assert here == there
    return together.together


@pytest.mark.parametrize("size", [7, 20, 50])
def test_a_demonstration_in_batches_that_wait_is_bit_for_bit_the_same(size):
    cuts = [size] * (len(MATRIX) // size)
    assert compared(stream(cuts, {})) > 35, "of 50 observations, the first ten by themselves"


def test_a_program_that_waits_to_be_published_is_not_published_just_before_the_next_is_made():
    cuts = [20] * (len(MATRIX) // 20)
    assert compared(stream(cuts, {}), apps_per_s=0.66) > 35


@pytest.mark.parametrize("late_s", [-0.03, 0.05, 0.25])
def test_a_wrong_guess_when_an_observation_is_complete_changes_nothing(late_s):
    assert compared(stream([20] * 200, {}), late_s=late_s) > 10


@pytest.mark.slow
def test_each_disturbance_leaves_the_same_behind():
    for kind in KINDS:
        compared(stream([20] * 170, {110: kind, 111: kind, 133: kind}))


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(
    st.lists(st.sampled_from([1, 10, 20, 20, 20, 33, 120]), min_size=100, max_size=200),
    st.dictionaries(st.integers(50, 200), st.sampled_from(KINDS), max_size=12),
    st.sets(st.integers(50, 200), max_size=2),
    st.lists(st.booleans(), max_size=200),
    st.sampled_from([0.0, 0.0, -0.02, 0.25]),
)
def test_whatever_happens_to_a_stream_it_is_the_same(cuts, disturbances, failures, works, late_s):
    steps = stream(cuts, disturbances)
    if failures or works:  # a command overtakes nothing, and a tick waits for no queue
        steps = [step for step in steps if step[0] != "tick"]
    compared(steps, failures, works, late_s)


def test_a_session_ends_at_its_limit_with_the_same_batch():
    assert compared(stream([20] * 170, {}), observations=20) > 0
