"""Kinds of calls to the disk fail in a service that runs, and in one that starts.

No station has a ring: what was acknowledged is in the journal or lost. Each time one station is opened,
taught, edited and closed while calls fail, and another one is taught before and after. Each command is
answered.
"""

from __future__ import annotations

import errno
import os
import resource
import select
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from itertools import count
from pathlib import Path
from typing import NamedTuple

from caesura_clients import query
from caesura_protocol.codec import decode, encode, pack_samples
from caesura_protocol.errors import CaesuraError, ProtocolError
from caesura_protocol.keys import SampleRange, station_key
from caesura_protocol.messages import Ack, Close, Command, Control, Edit, Insert, Open
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from faults.suite.outcome import Row
from faults.suite.stations import CONNECT_S, SESSION, demonstration
from harness.failing import FailingCalls
from harness.power import COMPILER, NO_COMPILER
from harness.processes import DEADLINE_S, ServiceProcess, eventually, running

BATCH = 10  # samples
BEFORE, BATCHES = 5, 20  # batches
EVENT_T = 0.5  # [s] of the edit
BESIDE = "beside"
ANSWER_S = 5.0
IDLE_S = 0.5  # in which a service whose disk fails does next to nothing
IDLE_SHARE = 0.4  # of a processor, at most
LOG_BYTES = 8000  # each time
LOOKS = 20  # for files that are open: some are for an instant
REASONS = ("journal", "missing before the close", "session is closed", "nothing has been observed yet")


class Failure(NamedTuple):
    """Calls of these kinds fail with this error, on paths that end with the suffix."""

    kinds: tuple[str, ...]
    error: int
    suffix: str = ""

    def __str__(self) -> str:
        return " ".join([*self.kinds, errno.errorcode[self.error], self.suffix]).strip()


OUT_OF_FILES = Failure((), errno.EMFILE)  # by the limit of the process: no call can open anything anywhere
RUNNING = (
    OUT_OF_FILES,
    Failure(("open",), errno.EMFILE),
    Failure(("open",), errno.EACCES),
    Failure(("open", "stat"), errno.EIO, ".sqlite"),
    Failure(("stat",), errno.EIO),
    Failure(("read",), errno.EIO),
    Failure(("write",), errno.EIO),
    Failure(("write", "fallocate"), errno.ENOSPC),
    Failure(("sync",), errno.EIO),
    Failure(("sync",), errno.ENOSPC),
    Failure(("truncate", "map"), errno.EIO),
    Failure(("chmod", "unlink", "mkdir"), errno.EACCES),
    Failure(("open", "read", "write", "sync", "truncate"), errno.EIO),
)
STARTING = (
    Failure(("open",), errno.EMFILE),
    Failure(("open",), errno.EACCES, "journal"),
    Failure(("open",), errno.EACCES, ".lock"),
    Failure(("open",), errno.EIO, "-shm"),
    Failure(("open",), errno.EACCES, "-wal"),
    Failure(("stat",), errno.EIO),
    Failure(("read",), errno.EIO),
    Failure(("read",), errno.EIO, "-wal"),
    Failure(("write",), errno.ENOSPC),
    Failure(("sync",), errno.EIO),
    Failure(("truncate",), errno.EIO),
    Failure(("map",), errno.ENOMEM),
    Failure(("chmod",), errno.EIO),
    Failure(("unlink",), errno.EACCES),
)


class FailingService(ServiceProcess):
    """Calls of it may fail; its log is in a file."""

    def __init__(self, directory: Path) -> None:
        self.calls = FailingCalls(directory / "journal", directory)
        self._log = directory / "log"
        super().__init__(self.calls.directory)
        self.command = self.calls.command(self.command)

    def begin(self) -> None:
        with self._log.open("a") as log:
            self._process = subprocess.Popen(self.command, stdout=subprocess.PIPE, stderr=log, text=True)

    @contextmanager
    def failing(self, failure: Failure) -> Iterator[None]:
        """While the context lasts calls fail so."""
        if failure != OUT_OF_FILES:
            with self.calls.failing(*failure):
                yield
            return
        before = resource.prlimit(self.pid, resource.RLIMIT_NOFILE)
        unused = min(self.first_unused() for _ in range(LOOKS))
        resource.prlimit(self.pid, resource.RLIMIT_NOFILE, (unused, before[1]))
        try:
            yield
        finally:
            resource.prlimit(self.pid, resource.RLIMIT_NOFILE, before)

    def first_unused(self) -> int:
        """The number that the next file gets."""
        used = {int(name) for name in os.listdir(f"/proc/{self.pid}/fd")}
        return next(number for number in count() if number not in used)

    @property
    def log(self) -> str:
        return self._log.read_text()

    @property
    def processor_s(self) -> float:
        fields = Path(f"/proc/{self.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def is_ready(self) -> bool | None:
        """Whether it has started; False once it has ended with an error, None while neither is so."""
        assert isinstance(self._process, subprocess.Popen)
        assert self._process.stdout is not None
        if not select.select([self._process.stdout], [], [], DEADLINE_S)[0]:
            return None
        return "ready" in self._process.stdout.readline() or not self._process.wait(DEADLINE_S)


class RinglessSession:
    """A session without a ring, and what was acknowledged of it."""

    def __init__(self, transport: ZenohTransport, station: str, wrong: list[str]) -> None:
        recording = demonstration(0)
        self._rows, self._columns = recording.matrix(), recording.columns
        self._transport, self.station, self._wrong = transport, station, wrong
        self.batches = self.revision = 0
        self.is_closed = False

    def ask(self, command: Command) -> bool:
        """Return whether a command is acknowledged; one that is refused has a reason."""
        content = encode(Control(command=command))
        answers = self._transport.query(station_key(self.station, "control"), content, timeout_s=ANSWER_S)
        if answers.replies:
            ack = decode(answers.replies[0].payload, answers.replies[0].encoding, Ack)
            if (ack.next_seq, ack.revision) < (self.batches, self.revision):
                self._wrong.append(f"{self.station} went back to {ack.next_seq} batches")
            self.batches, self.revision, self.is_closed = ack.next_seq, ack.revision, ack.state == "closed"
            return True
        why = answers.refusals[0].message if answers.refusals else "no answer"
        if not any(reason in why for reason in REASONS):
            self._wrong.append(f"{type(command).__name__} of {self.station}: {why}")
        return False

    def open(self) -> bool:
        return self.ask(Open(session=SESSION, columns=self._columns, wrench_source="flange_sensor"))

    def send(self, until: int) -> None:
        """The batches from the first one that is not acknowledged."""
        for seq in range(self.batches, until):
            rows = self._rows[seq * BATCH : (seq + 1) * BATCH]
            batch = pack_samples(rows, self._columns, session=SESSION, epoch=0, seq=seq)
            self._transport.put(station_key(self.station, "samples"), encode(batch))

    def edit(self) -> bool:
        return self.ask(Edit(session=SESSION, revision=0, author="Ann", action=Insert(t=EVENT_T)))

    def close(self) -> bool:
        return self.ask(Close(session=SESSION, last_seq=BATCHES - 1))

    def read_samples(self) -> None:
        """Ask for samples, which are read from the journal."""
        try:
            query.samples(self._transport, self.station, SESSION, SampleRange(0.0, 1.0, 10))
        except (ProtocolError, CaesuraError) as error:
            if not any(reason in str(error) for reason in REASONS):
                self._wrong.append(f"samples of {self.station}: {error}")

    def has(self, until: int) -> bool:
        """Whether so many batches are acknowledged, which are sent where they are not."""
        self.send(until)
        return self.open() and self.batches == until

    def finish(self) -> None:
        """Ask until everything is acknowledged."""
        eventually(self.is_closed_now)
        eventually(lambda: self.revision == 1 or self.edit())

    def is_closed_now(self) -> bool:
        if not self.is_closed:
            self.open()
            self.send(BATCHES)
            self.close()
        return self.is_closed


def disk_calls(
    directory: Path, while_running: Sequence[Failure] = RUNNING, while_starting: Sequence[Failure] = STARTING
) -> Row:
    """Each failure while the service runs, then each while it starts."""
    if COMPILER is None:
        return Row(0, 0, 0, 0, "–", None, NO_COMPILER, met=False)
    wrong: list[str] = []
    service = FailingService(directory)
    with running(service):
        with ZenohTransport(service.endpoint, timeout_s=CONNECT_S) as transport:
            beside = RinglessSession(transport, BESIDE, wrong)
            taught = [beside]
            failed = 0
            for number, failure in enumerate(while_running):
                one = RinglessSession(transport, f"cell-{number}", wrong)
                taught.append(one)
                failed += noted(service, failure, wrong, partial(taught_while, service, failure, one, beside))
            eventually(partial(beside.has, BATCHES))
            expected = shown(transport)
        said = sum(
            noted(service, failure, wrong, partial(started_while, service, failure, expected, wrong))
            for failure in while_starting
        )
    lost = sum(BATCHES - one.batches for one in taught)
    note = (
        f"{failed} calls of {len(while_running)} sorts failed while stations were taught; of "
        f"{len(while_starting)} starts {said} ended and said why; wrong: {len(wrong)}"
    )
    note += "".join(f"; {one}" for one in wrong[:3])
    sent = BATCH * BATCHES * len(taught)
    met = not wrong and not lost and bool(failed)
    return Row(len(taught), sent, BATCH * lost, 0, "no" if wrong else "yes", None, note, met)


def noted(service: FailingService, failure: Failure, wrong: list[str], done: Callable[[], int]) -> int:
    """Do it; what is wrong and what the log says of it names the failure."""
    known, length = len(wrong), len(service.log)
    found = done()
    log = service.log[length:]
    wrong += ["a traceback in the log"] if "Traceback" in log else []
    wrong += [f"{len(log)} bytes of log"] if len(log) > LOG_BYTES else []
    wrong[known:] = [f"{failure}: {why}" for why in wrong[known:]]
    return found


def taught_while(
    service: FailingService, failure: Failure, one: RinglessSession, beside: RinglessSession
) -> int:
    """Calls that failed."""
    eventually(one.open)
    eventually(partial(one.has, BEFORE))
    eventually(lambda: beside.has(beside.batches or 1))
    with service.failing(failure):
        other = RinglessSession(one._transport, f"{one.station}-new", one._wrong)
        other.open()
        one.send(BATCHES)
        beside.send(min(beside.batches + 1, BATCHES))
        one.open()
        beside.open()
        one.edit()
        one.read_samples()
        beside.read_samples()
        one.close()
        before, began = service.processor_s, time.monotonic()
        select.select([], [], [], IDLE_S)  # it does nothing else
        share = (service.processor_s - before) / (time.monotonic() - began)
        if share > IDLE_SHARE:
            one._wrong.append(f"{share:.2f} of a processor while nothing comes")
    one.finish()
    eventually(other.open)
    eventually(beside.open)
    return service.calls.failed


def started_while(service: FailingService, failure: Failure, expected: object, wrong: list[str]) -> int:
    """1 where it ended and said why."""
    service.kill()
    length = len(service.log)
    with service.failing(failure):
        service.begin()
        is_ready = service.is_ready()
    said = service.log[length:]
    if is_ready is None or (not is_ready and "caesura serve: journal" not in said):
        wrong.append(f"it does not start, and does not say why: {said[-200:]!r}")
    service.kill()
    service.start()
    with ZenohTransport(service.endpoint, timeout_s=CONNECT_S) as transport:
        if shown(transport) != expected:
            wrong.append("another result after the start")
    if any(service.calls.directory.glob("*damaged*")):
        wrong.append("a whole file was set aside")
    return int(is_ready is False)


def shown(transport: ZenohTransport) -> object:
    """All that is shown of every session."""
    found: list[object] = []

    def asked() -> bool:
        with suppress(ProtocolError, CaesuraError):
            snapshots = query.snapshots(transport)
            found[:] = sorted(
                (status.station, status.state, status.batches, status.revision, str(segments), str(apps))
                for status, segments, apps in (
                    (one.status, one.segments.segments, one.program.apps) for one in snapshots
                )
            )
            return True
        return False

    eventually(asked)
    return found
