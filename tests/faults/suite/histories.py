"""What several writers and editors did through kills and partitions, checked against a model (Jepsen's way).

Two writers open sessions, send their batches and close them; four editors insert changepoints, undo and redo,
in sessions that are open and in those that are closed. Each has a line of its own, which is cut and held up;
the service is killed. Every operation is noted with when it began, when it ended, and whether it was
acknowledged, refused, or neither. The model is a log of edits for each session and two stacks. An
acknowledged edit is in the log once, at the revision that was acknowledged; no refused one is. What ended
before another began stands before it. The samples, with what the stacks hold in the end, give what is shown.
"""

from __future__ import annotations

import random
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from caesura_clients.bridge.control_client import ControlClient
from caesura_clients.query import snapshot
from caesura_protocol.codec import encode, pack_samples, unpack_samples
from caesura_protocol.errors import CaesuraError, ProtocolError
from caesura_protocol.keys import station_key
from caesura_protocol.messages import (
    Ack,
    Close,
    Edit,
    Insert,
    Open,
    Redo,
    SampleBatch,
    Snapshot,
    TakeBack,
    Undo,
)
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from caesura_service.journal import AppliedEdit, Record, SqliteJournal
from caesura_service.segmentation.corrections import correction_of
from caesura_service.segmentation.pipeline import make_pipeline
from faults.suite.outcome import Row
from faults.suite.proxy import Proxy, proxied
from harness.demonstrations import taught
from harness.processes import ServiceProcess, eventually

SEED = 12
WRITERS, EDITORS, SESSIONS = 2, 4, 2  # sessions of each writer, one after the other
SECONDS, ROWS = 10.0, 100  # of a demonstration, and samples of a batch
PACE_S, THINK_S = 0.1, 0.05  # between two batches, and before an edit, at most
ANSWER_S = 1.0
HELD_UP_S = 1.5
COMMIT_S = 1.0  # that a batch may wait to be written: long, so that a kill takes what only seems to be safe
PATIENCE_S = 60.0
Key = tuple[str, str]
Fate = Literal["acknowledged", "refused", "unknown"]


@dataclass(frozen=True)
class Operation:
    """An edit, or a look at the revision, as its client saw it."""

    key: Key
    began: float  # [s] monotonic
    ended: float
    fate: Fate
    edit: Edit | None  # None: a look
    revision: int  # that was acknowledged or seen


@dataclass
class History:
    """What everybody did; any thread may append."""

    operations: list[Operation] = field(default_factory=list)
    openings: dict[Key, Open] = field(default_factory=dict)
    reached: dict[Key, int] = field(default_factory=dict)  # batches that were acknowledged
    closed: list[Key] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)

    @property
    def progress(self) -> int:
        """Answers that a writer went on with, or batches that they were for."""
        return sum(self.reached.values()) + len(self.openings) + len(self.closed)

    @property
    def acknowledged(self) -> int:
        """Edits."""
        return sum(one.fate == "acknowledged" for one in self.operations if one.edit)


# --- clients --------------------------------------------------------------------------------------------


def write(transport: ZenohTransport, station: str, number: int, history: History) -> None:
    """The sessions of a station, each from its opening to its end."""
    line = ControlClient(transport, station)
    for session in range(SESSIONS):
        recording = taught(10 * number + session, SECONDS)
        rows, columns = recording.matrix(), recording.columns
        opening = Open(session=f"s{session}", columns=columns, wrench_source="flange_sensor")
        key = (station, opening.session)
        last = len(rows) // ROWS - 1
        history.openings[key] = opening
        while (reached := insisted(line, opening, history, key).next_seq) <= last:
            for seq in range(reached, min(reached + 4, last + 1)):
                part = rows[seq * ROWS : (seq + 1) * ROWS]
                batch = pack_samples(part, columns, session=opening.session, epoch=0, seq=seq)
                transport.put(station_key(station, "samples"), encode(batch))
                time.sleep(PACE_S)  # a robot's own pace
        insisted(line, Close(session=opening.session, last_seq=last), history, key)
        history.closed.append(key)


def insisted(line: ControlClient, command: Open | Close, history: History, key: Key) -> Ack:
    """Ask until there is an answer. Raises ProtocolError for a refusal, TimeoutError."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        ack = line.ask(command, timeout_s=ANSWER_S)
        if ack is not None:
            if ack.next_seq < history.reached.get(key, 0):
                history.wrong.append(f"{key} went back from {history.reached[key]} to {ack.next_seq} batches")
            history.reached[key] = ack.next_seq
            return ack
    raise TimeoutError(f"{key}: no answer to {type(command).__name__} in {PATIENCE_S:g} s")


def edit(
    transport: ZenohTransport, name: str, history: History, rng: random.Random, over: threading.Event
) -> None:
    """Look at a session, and correct what is there; each edit has an author of its own."""
    count = 0
    while not over.wait(rng.uniform(0.0, THINK_S)):
        key = rng.choice([*history.openings] or [("", "")])
        began = time.monotonic()
        try:
            seen = snapshot(transport, *key).status
        except (CaesuraError, ProtocolError):
            continue
        history.operations.append(
            Operation(key, began, time.monotonic(), "acknowledged", None, seen.revision)
        )
        count += 1
        insert, any_of_them = Insert(t=rng.uniform(0.0, max(seen.t, 0.1))), TakeBack(number=rng.randint(1, 5))
        action = rng.choice([insert] * 4 + [Undo(), Undo(), Redo(), any_of_them])
        made = Edit(session=key[1], revision=seen.revision, author=f"{name}-{count}", action=action)
        history.operations.append(carried_out(transport, key, made, over))


def carried_out(transport: ZenohTransport, key: Key, made: Edit, over: threading.Event) -> Operation:
    """The same edit again and again until there is an answer; a refusal behind a silence proves nothing."""
    began, is_certain = time.monotonic(), True
    fate: Fate = "unknown"
    revision = -1
    while not over.is_set() and time.monotonic() < began + PATIENCE_S:
        try:
            ack = ControlClient(transport, key[0]).ask(made, timeout_s=ANSWER_S)  # type: ignore[arg-type]
        except ProtocolError:
            fate = "refused" if is_certain else "unknown"
            break
        if ack is not None:
            fate, revision = "acknowledged", ack.revision
            break
        is_certain = False
    return Operation(key, began, time.monotonic(), fate, made, revision)


# --- faults ---------------------------------------------------------------------------------------------


def disturb(
    service: ServiceProcess,
    lines: Sequence[Proxy],
    rng: random.Random,
    history: History,
    done: Callable[[], bool],
) -> Counter[str]:
    """One thing after the other until everything is written: kills, cuts, lines that are held up.

    Before the next one a writer has been answered, however slow the machine: else no session would end.
    """
    counts: Counter[str] = Counter()
    while not done():
        before = history.progress
        eventually(lambda before=before: done() or history.progress > before, PATIENCE_S)  # type: ignore[misc]
        what = rng.choice(["killed", "killed", "cut", "held up"])
        counts[what] += 1
        some = rng.sample(lines, k=rng.randint(1, len(lines) - 1))
        time.sleep(rng.uniform(0.2, 1.0))
        if what == "killed":
            service.kill()
            service.start()
        elif what == "cut":
            for line in some:
                line.cut()
        else:
            for line in some:
                line.flows = False
            time.sleep(HELD_UP_S)
            for line in some:
                line.flows = True
    return counts


def histories(directory: Path, seed: int = SEED) -> Row:
    """All of it, and what the model says of it."""
    rng, history, over = random.Random(seed), History(), threading.Event()
    service = ServiceProcess(directory, "--journal-commit-s", f"{COMMIT_S:g}")
    with ExitStack() as stack:
        stack.callback(service.kill)
        service.start()
        lines = [stack.enter_context(proxied(service.endpoint)) for _ in range(WRITERS + EDITORS)]
        transports = [stack.enter_context(ZenohTransport(line.endpoint, timeout_s=10.0)) for line in lines]
        pool = stack.enter_context(ThreadPoolExecutor(len(lines)))
        stack.callback(over.set)
        writers = [
            pool.submit(write, transports[number], f"cell-{number}", number, history)
            for number in range(WRITERS)
        ]
        editors = [
            pool.submit(edit, transport, f"editor-{number}", history, random.Random(seed + number), over)
            for number, transport in enumerate(transports[WRITERS:])
        ]
        counts = disturb(service, lines, rng, history, lambda: all(writer.done() for writer in writers))
        for writer in writers:
            writer.result()
        before = history.acknowledged
        eventually(lambda: history.acknowledged > before + EDITORS)  # of sessions that are all closed
        over.set()
        for editor in editors:
            editor.result(PATIENCE_S)
        service.kill()
        service.start()
        shown: dict[Key, Snapshot] = {}
        with ZenohTransport(service.endpoint, timeout_s=10.0) as transport:
            for key in history.openings:
                eventually(lambda key=key: look(transport, key, shown))  # type: ignore[misc]
    wrong = [*history.wrong]
    with SqliteJournal(directory / "caesura-1.sqlite", alone=False) as journal:
        for key in history.openings:
            wrong += checked(key, history, [*journal.replay(*key)], shown[key])
    return row(history, counts, wrong)


def look(transport: ZenohTransport, key: Key, shown: dict[Key, Snapshot]) -> bool:
    with suppress(CaesuraError, ProtocolError):
        shown[key] = snapshot(transport, *key)
    return key in shown


def row(history: History, counts: Counter[str], wrong: list[str]) -> Row:
    """What came of it; it proves nothing where nothing happened."""
    fates = Counter(one.fate for one in history.operations if one.edit)
    note = ", ".join(f"{count} times {what}" for what, count in sorted(counts.items()))
    note += "; edits: " + ", ".join(
        f"{fates[fate]} {fate}" for fate in ("acknowledged", "refused", "unknown")
    )
    note += f"; wrong: {len(wrong)}" + "".join(f"; {one}" for one in wrong[:3])
    sent = sum(history.reached.values()) * ROWS
    met = not wrong and bool(counts["killed"] and fates["acknowledged"] and fates["refused"])
    return Row(len(history.openings), sent, 0, 0, "no" if wrong else "yes", None, note, met)


# --- the model ------------------------------------------------------------------------------------------


def checked(key: Key, history: History, records: Sequence[Record], shown: Snapshot) -> list[str]:
    """What is wrong with a session, in words."""
    log = [record.message for record in records if isinstance(record.message, AppliedEdit)]
    mine = [one for one in history.operations if one.key == key]
    edits = {one.edit.author: one for one in mine if one.edit}
    batches = [record.message for record in records if isinstance(record.message, SampleBatch)]
    wrong = [*log_errors(log, edits), *order_errors(log, edits, mine)]
    if sorted(batch.seq for batch in batches) != [*range(history.reached[key])]:
        wrong.append(f"acknowledged were {history.reached[key]} batches, there are {len(batches)}")
    if (closes := sum(isinstance(record.message, Close) for record in records)) != 1:
        wrong.append(f"closed {closes} times")
    status = shown.status
    if (status.state, status.samples, status.repeats) != ("closed", history.reached[key] * ROWS, 0):
        wrong.append(f"{status.state} with {status.samples} samples, {status.repeats} of them again")
    return [f"{'/'.join(key)}: {one}" for one in [*wrong, *result_errors(log, batches, history, key, shown)]]


def log_errors(log: Sequence[AppliedEdit], edits: dict[str, Operation]) -> list[str]:
    """Every edit once, at its revision; none that was refused, or that nobody made."""
    wrong = []
    if [one.revision for one in log] != [*range(len(log))]:
        wrong.append(f"revisions are {[one.revision for one in log]}")
    counts = Counter(one.author for one in log)
    wrong += [f"{author} is there {count} times" for author, count in counts.items() if count > 1]
    for author, operation in edits.items():
        if operation.fate == "refused" and author in counts:
            wrong.append(f"{author} was refused and is there")
        elif operation.fate == "acknowledged":
            place = operation.revision - 1
            if not (0 <= place < len(log) and log[place].author == author):
                wrong.append(f"{author} was acknowledged as revision {operation.revision} and is not there")
    for one in log:
        if one.author not in edits or one.action != edits[one.author].edit.action:  # type: ignore[union-attr]
            wrong.append(f"{one.author} is there, made by nobody")
    return wrong


def order_errors(
    log: Sequence[AppliedEdit], edits: dict[str, Operation], mine: Sequence[Operation]
) -> list[str]:
    """What ended before something else began has the lower revision; a look sees what ended before it."""
    placed = [
        (place + 1, edits[one.author].began, edits[one.author].ended)
        for place, one in enumerate(log)
        if one.author in edits and edits[one.author].fate == "acknowledged"
    ]
    wrong = [
        f"revision {later} ended before revision {sooner} began"
        for sooner, began, _ in placed
        for later, _, ended in placed
        if sooner < later and ended < began
    ]
    for look_at in (one for one in mine if one.edit is None):
        known = max((revision for revision, _, ended in placed if ended < look_at.began), default=0)
        possible = min((revision for revision, began, _ in placed if began > look_at.ended), default=np.inf)
        if not known <= look_at.revision < possible:
            wrong.append(f"revision {look_at.revision} was seen, expected {known} or more, below {possible}")
    return wrong


def result_errors(
    log: Sequence[AppliedEdit],
    batches: Sequence[SampleBatch],
    history: History,
    key: Key,
    shown: Snapshot,
) -> list[str]:
    """The samples first, and then what the log leaves of the corrections, give what is shown."""
    made, active, undone = {}, list[int](), list[int]()
    for one in log:
        number = one.revision + 1
        if isinstance(one.action, Undo | TakeBack):
            undone.append(active[-1] if isinstance(one.action, Undo) else one.action.number)
            active.remove(undone[-1])
        elif isinstance(one.action, Redo):
            active = sorted([*active, undone.pop()])
        else:
            made[number] = one
            active, undone = [*active, number], []
    pipeline = make_pipeline(history.openings[key], "default")
    for batch in sorted(batches, key=lambda one: one.seq):
        pipeline.push(unpack_samples(batch))
    pipeline.finish()
    resolutions = [made[number].resolution for number in active]
    view = pipeline.corrected([correction_of(one) for one in resolutions if one is not None]).view
    status, program = shown.status, shown.program
    pairs = {
        "revision": (status.revision, len(log)),
        "undoable": (status.undoable, bool(active)),
        "redoable": (status.redoable, bool(undone)),
        "author": (program.author, log[-1].author if log else None),
        "corrections": (
            [(one.number, one.author, one.action, one.state == "undone") for one in program.corrections],
            [
                (number, made[number].author, made[number].action, number in undone)
                for number in sorted([*active, *undone])
            ],
        ),
        "segments": (shown.segments.segments, tuple(view.segments)),
        "changepoints": (shown.changepoints.changepoints, tuple(view.changepoints)),
        "apps": (program.apps, tuple(view.apps)),
    }
    return [f"{name} differ" for name, (is_, should) in pairs.items() if is_ != should]
