"""A short scripted session on a real journal: the k-th call to the disk fails, k = 1, 2, 3 … until none does.

`python -m faults.suite.io_errors_process DIRECTORY [STRIDE]`; STRIDE: only every so many-th k.

The process is started with `harness/failing.c` preloaded. After every acknowledgement the service is killed
and started again, and must have what it acknowledged. Two other sessions, one open and one closed, are in the
same journal. A client does what a bridge and an editor do: it asks again, and answers what it is asked.
"""

from __future__ import annotations

import ctypes
import json
import logging
import shutil
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

from caesura_protocol.messages import Ack, Edit, Insert
from caesura_service.journal import JournalError, JournalSettings, SqliteJournal
from caesura_service.ownership.registry import Registry
from caesura_service.publishing.events import Output, RequestReplay, TakeoverFailed
from caesura_service.publishing.session_state import snapshot_of
from harness.sessions import NAME, STATION, Ring, answer, batches, closing, new_registry, opening, unowned

COUNT = 9
BATCHES = batches(COUNT)
OTHERS = ("open-one", "closed-one")
ON_SIGNAL = JournalSettings(commit_s=3600.0)  # so that the calls come in the same order every time
ATTEMPTS = 12
EVENT_T = 0.535  # [s] of the edit
MODES = {"once": 1, "until it is said": 0}


class Shim:
    """What fails."""

    def __init__(self) -> None:
        library = ctypes.CDLL(None)
        self._from, self.pause = library.fail_from, library.fail_pause
        self._from.restype, self._from.argtypes = ctypes.c_long, (ctypes.c_long, ctypes.c_int)

    def begin(self, call: int, only_once: int) -> None:
        """From that call on."""
        self._from(call, only_once)

    def end(self) -> int:
        """Calls that have failed since the beginning; from here on none fails."""
        return int(self._from(0, 0))


class FailureOutcome(NamedTuple):
    """What came of one failure."""

    failed: int  # calls
    said: list[str]  # why something was refused, or could not be started
    wrong: list[str]


class ServiceWithClient:
    """A service on a journal, with its client."""

    def __init__(self, directory: Path, shim: Shim) -> None:
        self.shim, self.directory, self.starts = shim, directory, 0
        self.said: list[str] = []
        self.wrong: list[str] = []
        self.ring, self.now = Ring(BATCHES), 0.0
        self.next_seq = self.revision = 0  # that were acknowledged
        self.registry: Registry
        self.journal: SqliteJournal

    # --- the service ------------------------------------------------------------------------------------

    def start(self) -> None:
        """Again, where it says why it cannot."""
        for _ in range(ATTEMPTS):
            journal = SqliteJournal(self.directory / "j.sqlite", ON_SIGNAL)
            try:
                self.journal = journal.__enter__()
            except JournalError as error:
                self.refused(str(error))
                continue
            self.registry = new_registry(self.journal)
            try:
                for left_out in self.registry.restore(self.now):
                    self.refused(str(left_out.error))
            except JournalError as error:
                self.refused(str(error))
                self.stop()
                continue
            return
        raise AssertionError(f"it does not start: {self.said}")

    def kill(self) -> None:
        """It takes what waits with it, and leaves the files as they are; the next one starts on those."""
        self.shim.pause(1)
        self.starts += 1
        after = self.directory.with_name(f"{self.directory.name}-{self.starts}")
        after.mkdir()
        for file in self.directory.iterdir():
            if not file.name.endswith("-shm"):
                shutil.copy(file, after / file.name)
        self.journal._waiting.clear()
        self.journal._waiting_bytes = 0
        self.stop()
        shutil.rmtree(self.directory)
        self.directory = after
        self.shim.pause(0)

    def stop(self) -> None:
        try:
            self.journal.__exit__(None, None, None)
        except JournalError as error:
            self.refused(str(error))

    # --- its client -------------------------------------------------------------------------------------

    def refused(self, why: str) -> None:
        """A reason names the journal; the operator does something about it."""
        self.said.append(why)
        if "journal" not in why:
            self.wrong.append(f"no reason: {why}")
        self.shim.end()

    def acknowledged(self, message: Any) -> Ack:
        """Ask until it is; answer what the service asks."""
        for _ in range(ATTEMPTS):
            said = self.registry.handle_command(STATION, message, self.tick())
            reply = answer(said)
            self.replay(said)
            if isinstance(reply, Ack):
                self.next_seq, self.revision = reply.next_seq, reply.revision
                return reply
            if isinstance(message, Edit) and reply.code == "conflict":
                self.wrong.append(f"an edit that was refused has been carried out: {reply}")
            if "journal " in reply.message or reply.code == "internal":
                self.refused(reply.message)
            self.step()
        raise AssertionError(f"never acknowledged: {message!r:.80}, but {reply}")

    def send(self, *numbers: int) -> None:
        for seq in numbers:
            self.replay(self.registry.handle_samples(STATION, BATCHES[seq], self.tick()))

    def replay(self, outputs: list[Output]) -> None:
        """Answer what is asked, like a bridge."""
        waiting = [output for output in outputs if isinstance(output, RequestReplay)]
        while waiting:
            for reply in self.ring.answer(waiting.pop(0)):
                said = self.registry.handle_samples(STATION, reply, self.tick())
                waiting += [output for output in said if isinstance(output, RequestReplay)]
                if len(self.said) < ATTEMPTS and (trouble := self.registry.journal_report().trouble):
                    self.refused(trouble)

    def step(self) -> None:
        """Time passes: the journal's thread tries again, and what is to be rebuilt is."""
        with suppress(JournalError):
            self.journal.commit()
        self.registry.tick(self.tick())
        while self.registry.rebuilding:
            for output in self.registry.rebuild_step(STATION):
                if isinstance(output, TakeoverFailed):
                    self.refused(str(output.error))

    def tick(self) -> float:
        self.now += 1.0
        return self.now

    # --- the script -------------------------------------------------------------------------------------

    def begun_again(self) -> None:
        """Killed and started: what was acknowledged is there."""
        before = self.next_seq, self.revision
        self.kill()
        self.start()
        ack = self.acknowledged(opening())
        if (ack.next_seq, ack.revision) < before or ack.revision < before[1]:
            self.wrong.append(f"acknowledged were {before}, there are {(ack.next_seq, ack.revision)}")

    def script(self) -> None:
        """A session from its opening to its end."""
        self.start()
        self.acknowledged(opening())
        self.send(0, 1, 2, 3)
        self.acknowledged(opening())
        self.begun_again()
        self.send(4, 6, 5)
        edit = Edit(session=NAME, revision=0, author="Ann", action=Insert(t=EVENT_T))
        self.acknowledged(edit)
        self.begun_again()
        self.send(7, 8)
        self.acknowledged(closing(COUNT - 1))
        self.kill()
        self.start()


def shown(registry: Registry, station: str) -> object:
    """All that it shows of its session, but when it was edited, and the number of the program's version."""
    (session,) = registry.index.sessions[station]
    snapshot = snapshot_of(unowned(session.state))
    status = snapshot.status
    counted = (status.state, status.samples, status.repeats, status.gaps, status.revision, status.batches)
    corrections = tuple(one.model_copy(update={"at": 0.0}) for one in snapshot.program.corrections)
    changed = {"edited": None, "version": 0, "corrections": corrections}
    program = snapshot.program.model_copy(update=changed)
    return snapshot.segments.segments, snapshot.changepoints.changepoints, program, counted


def others(registry: Registry) -> None:
    """The sessions that nobody touches."""
    for station in OTHERS:
        registry.handle_command(station, opening(), 0.0)
        for made in BATCHES:
            registry.handle_samples(station, made, 0.0)
    registry.handle_command(OTHERS[1], closing(COUNT - 1), 0.0)
    registry.handle_command(OTHERS[0], opening(), 0.0)


def tried(
    prepared: Path, directory: Path, shim: Shim, fail: Callable[[], None], expected: object
) -> FailureOutcome:
    """The script with one failure, and what is there in the end."""
    shutil.copytree(prepared, directory)
    instance = ServiceWithClient(directory, shim)
    fail()
    try:
        instance.script()
    except Exception as error:  # the service would have logged it, and its sender know nothing
        instance.wrong.append(f"{type(error).__name__}: {error}")
    failed = shim.end()
    if not instance.wrong:
        instance.kill()
        instance.start()
        if (found := everything(instance.registry)) != expected:
            instance.wrong.append(f"differs: {difference(found, expected)}")
        instance.stop()
    for file in instance.directory.glob("*damaged*"):
        instance.wrong.append(f"a whole file was set aside as {file.name}")
    shutil.rmtree(instance.directory, ignore_errors=True)
    return FailureOutcome(failed, instance.said, instance.wrong)


def everything(registry: Registry) -> dict[str, object]:
    """By station; None where it has no session."""
    known = registry.index.sessions
    return {name: shown(registry, name) if known.get(name) else None for name in (STATION, *OTHERS)}


def difference(found: dict[str, object], expected: object) -> list[str]:
    assert isinstance(expected, dict)
    return [station for station in expected if found[station] != expected[station]]


def main(directory: Path, stride: int = 1) -> None:
    """Prints a line for each mode: how many failures, how many of them were said, what was wrong."""
    logging.disable()
    shim = Shim()
    prepared = directory / "prepared"
    prepared.mkdir()
    with SqliteJournal(prepared / "j.sqlite", ON_SIGNAL) as journal:
        others(new_registry(journal))
    whole = ServiceWithClient(directory / "whole", shim)
    shutil.copytree(prepared, whole.directory)
    whole.script()
    assert whole.said + whole.wrong == []
    expected = everything(whole.registry)
    whole.stop()
    for mode, only_once in MODES.items():
        wrong: dict[int, list[str]] = {}
        failures = said = 0
        for call in count(1, stride):
            fail = partial(shim.begin, call, only_once)
            found = tried(prepared, directory / f"run-{only_once}-{call}", shim, fail, expected)
            if not found.failed:
                break
            failures += 1
            said += bool(found.said)
            if found.wrong:
                wrong[call] = found.wrong
        print(json.dumps({"mode": mode, "failures": failures, "said": said, "wrong": wrong}), flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:]))
