"""The journal's disk: full, unwritable, damaged."""

from __future__ import annotations

import resource
import sqlite3
import subprocess
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from functools import partial
from pathlib import Path

from caesura_clients import Caesura, connect
from caesura_protocol.errors import CaesuraError
from faults.suite.outcome import FULL, Disturbance, Row, Scale, played
from faults.suite.stations import TaughtStation, reached
from harness.processes import DEADLINE_S, ServiceProcess, eventually

DISK_MB = 32
DAMAGE = b"\xff" * 4096
CHUNK = bytes(1 << 16)


@contextmanager
def small_disk(directory: Path) -> Iterator[None]:
    """A file system of its own. Raises CalledProcessError where mounting is not permitted."""
    mount = ["mount", "-t", "tmpfs", "-o", f"size={DISK_MB}m", "tmpfs", str(directory)]
    subprocess.run(mount, check=True, capture_output=True)
    try:
        yield
    finally:
        subprocess.run(["umount", directory], check=True)


def disk_full(directory: Path) -> Row:
    """A tmpfs that somebody fills, and that has room again after a while."""
    ballast = directory / "ballast"

    def fill() -> None:
        with suppress(OSError), ballast.open("wb", buffering=0) as file:
            while True:
                file.write(CHUNK)

    try:
        with small_disk(directory):
            return in_trouble(ServiceProcess(directory), fill, ballast.unlink, f"{DISK_MB} MB tmpfs filled")
    except subprocess.CalledProcessError:
        return Row(0, 0, 0, 0, "–", None, "not run: mounting is not permitted; see disk-unwritable", met=True)


def disk_unwritable(directory: Path, scale: Scale = FULL) -> Row:
    """Every write fails, as on a disk that the kernel made read-only: by the process' limit on file sizes."""
    service = ServiceProcess(directory)

    def limit(size: int) -> None:
        resource.prlimit(service.pid, resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))

    end = partial(limit, resource.RLIM_INFINITY)
    return in_trouble(service, partial(limit, 0), end, "RLIMIT_FSIZE 0", scale)


def in_trouble(
    service: ServiceProcess, begin: Callable[[], None], end: Callable[[], None], how: str, scale: Scale = FULL
) -> Row:
    """The journal cannot write from a fifth to half of the demonstrations, and the status says so."""
    reported: list[str] = []

    def disturb(stations: list[TaughtStation], disturbance: Disturbance) -> None:
        reached(stations, 0.2)
        begin()
        with connect(service.endpoint, timeout_s=DEADLINE_S) as caesura:
            eventually(lambda: bool(reported.extend(troubles(caesura)) or reported))
        reached(stations, 0.5)
        end()
        disturbance.is_over()

    try:
        service.start()
        done = played(service.endpoint, service.journal, disturb, scale=scale)
    finally:
        service.kill()
    refused = [sum(one.snapshot.status.refused.values()) for one in done.found]
    note = f"{how}; batches refused as overloaded: {sum(refused)}; status: …{reported[0][-80:]}"
    return done.row(note=note, ignoring={"refusals"}, met=min(refused) > 0)


def troubles(caesura: Caesura) -> list[str]:
    """What journals complain of."""
    with suppress(CaesuraError):
        reports = [status.journal for status in caesura.services()]
        return [report.trouble for report in reports if report and report.trouble]
    return []


def log_damaged(directory: Path) -> Row:
    """The last page of the log is rubbish when a killed service starts again: the bridges have it."""
    return damaged(directory, tail_of_log)


def file_damaged(directory: Path) -> Row:
    """So is the beginning of the file: the service refuses it with the remedy, which is then followed."""
    return damaged(directory, head_of_file)


def file_torn(directory: Path) -> Row:
    """A page in the middle of the file is rubbish: the service sets the file aside and begins anew."""
    return damaged(directory, middle_of_file)


def tail_of_log(service: ServiceProcess) -> str:
    log = service.journal / "caesura-1.sqlite-wal"
    log.write_bytes(log.read_bytes()[: -len(DAMAGE)] + DAMAGE)
    return "last page of the log"


def checkpointed(service: ServiceProcess) -> Path:
    """The file, with everything in it: what is in the log would heal it."""
    file = service.journal / "caesura-1.sqlite"
    with closing(sqlite3.connect(file)) as database:
        database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    return file


def middle_of_file(service: ServiceProcess) -> str:
    file = checkpointed(service)
    content = bytearray(file.read_bytes())
    middle = len(content) // (2 * len(DAMAGE)) * len(DAMAGE)
    content[middle : middle + len(DAMAGE)] = DAMAGE
    file.write_bytes(content)
    return f"page {middle // len(DAMAGE)} of {len(content) // len(DAMAGE)}, set aside by the service"


def head_of_file(service: ServiceProcess) -> str:
    file = checkpointed(service)
    file.write_bytes(DAMAGE + file.read_bytes()[len(DAMAGE) :])
    refused = subprocess.run(service.command, capture_output=True, text=True, timeout=DEADLINE_S, check=False)
    assert refused.returncode == 1, "a damaged journal was accepted"
    assert "move it away" in refused.stderr, refused.stderr
    for part in service.journal.glob("caesura-1.sqlite*"):
        part.rename(part.with_name(f"damaged-{part.name}"))
    return f"refused: …{refused.stderr.strip()[-70:]}; moved away"


def damaged(directory: Path, damage: Callable[[ServiceProcess], str]) -> Row:
    """A service is killed, its journal damaged, and it is started again."""

    def disturb(stations: list[TaughtStation], disturbance: Disturbance) -> None:
        reached(stations, 0.4)
        service.kill()
        disturbance.note = damage(service)
        disturbance.is_over()
        service.start()

    service = ServiceProcess(directory)
    try:
        service.start()
        return played(service.endpoint, directory, disturb).row()
    finally:
        service.kill()
