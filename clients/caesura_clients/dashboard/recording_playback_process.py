"""Inspects a recording, or plays it to the service, in a separate process: pages are not blocked.

    python -m caesura_clients.dashboard.recording_playback_process < job.json

A job is one JSON object, and so is every line of the output. `look` returns what the recording states and
what it leaves open. `play` opens a session as a bridge does, and reports the share of samples sent. An error
is {"error": words}. A child process can be ended, which frees its memory.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, get_args

import numpy as np

from caesura_clients.bridge import BridgeSettings
from caesura_clients.bridge.sources import Chunk
from caesura_clients.bridge.sources.file import FileSource
from caesura_clients.bridge.sources.paced_source import FAST
from caesura_clients.bridge.sources.registry import SourceOptions, open_source
from caesura_clients.client import connect
from caesura_protocol.errors import CaesuraError, ProtocolError, SourceError, Unreachable
from caesura_protocol.formats.csv_layout_detection import CsvLayout, guessed, read_layout, with_turns
from caesura_protocol.formats.mapping_file_write import MappingAnswers, mapping_text
from caesura_protocol.formats.read import load_recording
from caesura_protocol.messages import Description, Quantity
from caesura_protocol.package_version_and_extras import import_extra
from caesura_protocol.plausibility import WIRE_UNIT
from caesura_protocol.programs.safety import CellSettings
from caesura_protocol.recording import Recording, RecordingError
from caesura_protocol.up_direction import parse_up

CONNECT_S = 5.0
OPEN_S = 20.0  # until a service has opened the session
STALL_S = 30.0  # without an acknowledged sample
TICK_S = 0.2
MEMORY = 4 << 30  # [bytes] of addresses: a file of a few megabytes can unfold to all that a machine has
UNHURRIED = 19  # of `nice`: pages and the service come first
SHOWN_ROWS = 3  # of a csv
BAGS = (".db3",)  # beside a directory, and an MCAP of ROS 2
Job = Mapping[str, Any]


class CountedSource(FileSource):
    """A recording that is played without waiting; it counts the samples that were read."""

    taken = 0

    def chunks(self) -> Iterator[Chunk]:
        """Yield the chunks of the recording and count their samples."""
        for chunk in super().chunks():
            yield chunk
            self.taken += len(chunk)


def look(job: Job) -> dict[str, Any]:
    """Return what a recording states and leaves open. Raises RecordingError if it cannot be read."""
    path = Path(job["file"])
    if path.suffix.lower() == ".csv" and not (layout := read_layout(path)).is_own:
        return _of_csv(layout)
    return _of_recording(path) | {"bag": is_bag(path)}


def _of_csv(layout: CsvLayout) -> dict[str, Any]:
    guess = with_turns(layout, guessed(layout))
    return {
        "header": list(layout.header),
        "rows": [list(row) for row in layout.rows[:SHOWN_ROWS]],
        "guess": {"columns": dict(guess.columns), "units": dict(guess.units)},
        "delimiter": layout.delimiter,
        "decimal": layout.decimal,
        "stated": dict(layout.stated),
    }


def _read_whole(path: Path) -> tuple[Recording, Mapping[str, str]]:
    """Return the recording in its own units, and its statements; a bag may state nothing on its wrench."""
    try:
        recording = load_recording(path, check_units=False)
    except RecordingError:
        if not is_bag(path):
            raise
        mapping = path.with_name(f"{path.name}.look.toml")
        mapping.write_text('wrench_source = "flange_sensor"\nforce_frame = "base"\n', encoding="utf-8")
        try:
            return load_recording(path, check_units=False, mapping=mapping), {}
        finally:
            mapping.unlink()
    return recording, recording.stated_options


def _of_recording(path: Path) -> dict[str, Any]:
    recording, stated = _read_whole(path)
    wrong = recording.implausible
    return {
        "samples": int(recording.t.size),
        "length": round(float(np.ptp(recording.t)), 2),
        "signals": list(recording.signals),
        "stated": dict(stated),
        "hasWrench": recording.has_wrench,
        "ignored": list(recording.ignored),
        "notes": [*recording.assumed, *recording.cautions],
        "wrong": "" if wrong is None else f"{wrong}.",
        "likely": {} if wrong is None or wrong.likely is None else {wrong.quantity: wrong.likely},
    }


def source_of(job: Job) -> CountedSource:
    """Return the source for a job's recording with its answers. Raises RecordingError or SourceError."""
    path, answers = Path(job["file"]), dict(job["answers"])
    units = answers.pop("declared", {})
    options: dict[str, Any] = {f"{quantity}_unit": units.get(quantity) for quantity in get_args(Quantity)}
    if answers.pop("sure", False):  # the values are believed in the units that were chosen
        options |= {key: options[key] or WIRE_UNIT[_quantity(key)] for key in options}
    if answers.get("columns") or is_bag(path):
        options["mapping"] = path.with_name(f"{path.name}.toml")
        text = mapping_text(MappingAnswers(**{"columns": {}, **answers}))
        options["mapping"].write_text(text, encoding="utf-8")
        report({"mapping": text})
    else:
        options |= {
            key: answers.get(key) or None for key in ("wrench_source", "hand_on_robot", "force_frame")
        }
    source = open_source("file", SourceOptions(file=path, pace=FAST, **options))
    if not isinstance(source, FileSource):
        raise SourceError(f"{path.name}: not a recording")
    return CountedSource(source.recording, pace=FAST)


def _quantity(option: str) -> Quantity:
    return next(one for one in get_args(Quantity) if option == f"{one}_unit")


def is_bag(path: Path) -> bool:
    """Return whether a recording is a ROS 2 bag: its wrench source and frame are stated in a mapping."""
    if path.suffix.lower() == ".mcap" and path.is_file():
        with import_extra("mcap", path.name):
            from caesura_protocol.formats.mcap_read import ROS2, profile_of  # noqa: PLC0415 - an extra
        with suppress(ValueError):  # it cannot be read
            return profile_of(path) == ROS2
        return False
    return path.is_dir() or path.suffix.lower() in BAGS


def play(job: Job) -> dict[str, Any]:
    """Play a recording to the service as a session. Raises CaesuraError or ProtocolError."""
    with _ended_after(job["read_s"]):
        source, up = source_of(job), job["answers"].get("up")
    setting = CellSettings(robot=job["answers"].get("robot"), up=None if up is None else parse_up(up))
    of = int(source.recording.t.size)
    config = None if job["config"] is None else Path(job["config"])
    with (
        connect(job["endpoint"], config_file=config, timeout_s=CONNECT_S) as caesura,
        caesura.bridge(
            job["station"],
            source,
            session=job["session"],
            settings=BridgeSettings(setting=setting),
            description=Description(**job["description"]),
        ) as bridge,
    ):
        try:
            bridge.wait_open(OPEN_S)
        except Unreachable as error:
            raise Unreachable(f"{error}; {NEEDED}") from error
        report({"opened": True})
        if bridge.ignored_up is not None:
            report({"warning": bridge.ignored_up})
        over = threading.Event()
        watching = threading.Thread(target=_watch, args=(source, of, over), daemon=True)
        watching.start()
        try:
            bridge.run()
        finally:
            over.set()
            watching.join()
    return {"share": 1.0, "samples": of}


NEEDED = (
    "where access rules hold, the dashboard needs a bridge's credentials of this station: "
    "`caesura dashboard --bridge-config`"
)


@contextmanager
def _ended_after(seconds: float) -> Iterator[None]:
    """End the process, by SIGALRM, if the context lasts longer: the number of such processes is limited."""
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def _watch(source: CountedSource, of: int, over: threading.Event) -> None:
    """Report the share of samples sent; end the process if the service accepts no more."""
    taken, since = -1, time.monotonic()
    while not over.wait(TICK_S):
        now = time.monotonic()
        if source.taken != taken:
            taken, since = source.taken, now
            report({"share": round(taken / of, 4)})
        elif now - since > STALL_S:
            report({"error": f"the service acknowledged nothing for {STALL_S:g} s; {NEEDED}"})
            os._exit(1)


def report(line: Mapping[str, Any]) -> None:
    """Write one line of the output."""
    print(json.dumps(line), flush=True)


def run(job: Job) -> int:
    """Carry out a job and report its result; return the exit code, 1 after an error."""
    with suppress(ValueError, OSError):  # where this system has no such limit
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    try:
        report({"look": look, "play": play}[job["do"]](job) | {"done": True})
    except (CaesuraError, ProtocolError) as error:
        report({"error": str(error).removeprefix("malformed: ")})
        return 1
    except MemoryError:
        report({"error": f"{Path(job['file']).name}: needs more memory than {MEMORY >> 30} GB"})
        return 1
    return 0


if __name__ == "__main__":
    os.nice(UNHURRIED)
    sys.exit(run(json.load(sys.stdin)))
