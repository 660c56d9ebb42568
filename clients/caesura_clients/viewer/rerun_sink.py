"""Sends a station's messages to a running Rerun viewer, or writes them to an rrd file.

Needs the extra `rerun`. Samples are collected for FLUSH_S and sent as columns, because a call for each sample
costs too much at 1 kHz. A segment that changes replaces its row in the table of segments; once it is final it
is a line of the log. The SDK's own server listens on every interface, so this command serves nothing: it
connects to a viewer.
"""

from __future__ import annotations

import socket
import threading
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self
from urllib.parse import urlsplit

import numpy as np
import rerun as rr

from caesura_clients.viewer.live_mcap_messages import LiveMessage
from caesura_protocol.app_kinds import APP_KINDS
from caesura_protocol.errors import CaesuraError
from caesura_protocol.number_words import counted

APPLICATION, TIMELINE = "caesura", "time"
FLUSH_S = 0.1
CONNECT_S = 2.0
ROWS = 20  # of the table of segments
Waiting = dict[str, tuple[list[int], list[list[float]]]]  # by entity: times [ns] and rows
SAMPLES = ("/state", "/wrench")


class RerunSink:
    """Sends messages while its context lasts; a sink for `StationFeed`.

    Entering the context raises CaesuraError if no viewer answers, or the file cannot be written.
    """

    def __init__(self, name: str, *, viewer: str | None = None, file: Path | None = None) -> None:
        """viewer: its address, such as rerun+http://127.0.0.1:9876/proxy.

        file: the rrd file to write instead.
        """
        self._name, self._viewer, self._file = name, viewer, file
        self._recording: Any = None
        self._lock = threading.Lock()
        self._waiting: Waiting = {}
        self._segments: dict[float, Mapping[str, Any]] = {}  # by their beginning
        self._logged: set[tuple[str, float]] = set()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="rerun", daemon=True)

    def __enter__(self) -> Self:
        if self._viewer is not None:
            _check_viewer(self._viewer)
        self._recording = rr.RecordingStream(APPLICATION)
        try:
            if self._file is not None:
                self._recording.save(self._file)
            else:
                self._recording.connect_grpc(self._viewer)
        except (OSError, RuntimeError, ValueError) as error:
            raise CaesuraError(f"{self._file or self._viewer}: {error}") from error
        self._recording.send_recording_name(self._name)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._thread.join()
        self._recording.disconnect()

    def publish(self, message: LiveMessage) -> None:
        """Send a message; samples are buffered until the next flush."""
        with self._lock:
            if message.topic in SAMPLES:
                self._collect(message)
            else:
                self._recording.set_time(TIMELINE, timestamp=np.datetime64(message.log_time, "ns"))
                SHOWN[message.topic](self, message.fields)

    def state(self, session: str, missing: int) -> None:
        """Log the current session, and the number of its batches that were not received."""
        with self._lock:
            lost = f": {counted(missing, 'batch')} not received" if missing else ""
            level = rr.TextLogLevel.WARN if missing else rr.TextLogLevel.INFO
            self._recording.log("log", rr.TextLog(f"session {session}{lost}", level=level))
            if not missing:  # a session begins
                self._segments.clear()
                self._logged.clear()

    # --- samples ---

    def _collect(self, message: LiveMessage) -> None:
        for name, value in message.fields.items():
            if name == "t":
                continue
            times, rows = self._waiting.setdefault(f"{message.topic[1:]}/{name}", ([], []))
            times.append(message.log_time)
            rows.append(list(value) if isinstance(value, list | tuple) else [float(value)])  # type: ignore[arg-type]

    def _run(self) -> None:
        while not self._over.wait(FLUSH_S):
            self._flush()
        self._flush()

    def _flush(self) -> None:
        with self._lock:
            waiting, self._waiting = self._waiting, {}
            for entity, (times, rows) in waiting.items():
                index = rr.TimeColumn(TIMELINE, timestamp=np.array(times, dtype="datetime64[ns]"))
                lengths = [len(row) for row in rows]
                columns = rr.Scalars.columns(scalars=np.concatenate(rows)).partition(lengths)
                self._recording.send_columns(entity, [index], columns)

    # --- results ---

    def _transform(self, fields: Mapping[str, Any]) -> None:
        place, turned = fields["translation"], fields["rotation"]
        flange = rr.Transform3D(
            translation=[place[axis] for axis in "xyz"],
            quaternion=rr.Quaternion(xyzw=[turned[axis] for axis in "xyzw"]),
        )
        self._recording.log("flange", flange)

    def _path(self, fields: Mapping[str, Any]) -> None:
        points = [[pose["position"][axis] for axis in "xyz"] for pose in fields["poses"]]
        self._recording.log("path", rr.LineStrips3D([points]))

    def _segment(self, fields: Mapping[str, Any]) -> None:
        self._segments[fields["t0"]] = fields
        later = [t0 for t0 in self._segments if fields["t0"] < t0 < fields["tn"]]  # that it replaces
        for t0 in later:
            del self._segments[t0]
        newest = sorted(self._segments.items())[-ROWS:]
        rows = [f"| {_span(one)} | {one['kind']} | {one['probability']:.2f} |" for _, one in newest]
        table = "\n".join(["| from, to | kind | p |", "|---|---|---|", *rows])
        self._document("segments", table)
        if fields["certainty"] == "final":
            self._line("segments", fields, f"{fields['kind']} {_span(fields)}")

    def _phase(self, fields: Mapping[str, Any]) -> None:
        if fields["certainty"] == "final":
            self._line("phases", fields, f"phase {fields['kind']} {_span(fields)}")

    def _changepoint(self, fields: Mapping[str, Any]) -> None:
        if fields["certainty"] == "final":
            self._line(
                "changepoints", fields, f"changepoint {fields['t']:.2f} s, p {fields['probability']:.2f}"
            )

    def _gap(self, fields: Mapping[str, Any]) -> None:
        self._line("gaps", fields, f"gap {_span(fields)}", level=rr.TextLogLevel.WARN)

    def _program(self, fields: Mapping[str, Any]) -> None:
        apps = [
            f"{number}. {APP_KINDS[app['kind']].title}, {_span(app)}"
            for number, app in enumerate(fields["apps"], start=1)
        ]
        self._document("program", "\n".join([*apps, "", *(f"- {note}" for note in fields["notes"])]))

    def _document(self, entity: str, text: str) -> None:
        self._recording.log(entity, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))

    def _line(
        self, entity: str, fields: Mapping[str, Any], words: str, level: Any = rr.TextLogLevel.INFO
    ) -> None:
        """Log a line of text, once for each result."""
        key = entity, float(fields.get("t0", fields.get("t", 0.0)))
        if key not in self._logged:
            self._logged.add(key)
            self._recording.log(f"log/{entity}", rr.TextLog(words, level=level))


#: How a message of a topic is shown; samples are collected.
SHOWN = {
    "/tf": RerunSink._transform,
    "/path": RerunSink._path,
    "/segments": RerunSink._segment,
    "/phases": RerunSink._phase,
    "/changepoints": RerunSink._changepoint,
    "/gaps": RerunSink._gap,
    "/program": RerunSink._program,
}


def _span(fields: Mapping[str, Any]) -> str:
    return f"{fields['t0']:.2f} to {fields['tn']:.2f} s"


def _check_viewer(address: str) -> None:
    """Raise CaesuraError if no viewer answers: the SDK would wait for one silently."""
    where = urlsplit(address)
    try:
        socket.create_connection((where.hostname or "", where.port or 0), CONNECT_S).close()
    except (OSError, ValueError) as error:
        raise CaesuraError(
            f"{address}: no Rerun viewer answers ({error}); start one with `rerun`, or use --save FILE"
        ) from error
