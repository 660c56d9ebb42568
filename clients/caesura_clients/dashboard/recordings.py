"""Recordings that an operator drops into the page: stores them, inspects them, and plays them to the service.

Files are stored in a separate folder (`upload_folder`). A separate process reads their content
(`recording_playback_process`). All sizes are limited: BYTES of a recording, UPLOADS stored, PLAYS at a time.
Requests of a browser are not trusted: names of files, stations and columns are validated.
"""

from __future__ import annotations

import json
import re
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StringConstraints, ValidationError

from caesura_clients.dashboard.correction_requests import EditRefused, said
from caesura_clients.dashboard.upload_folder import UploadFolder, remove_abandoned
from caesura_protocol.errors import printable
from caesura_protocol.formats.csv_read_mapped import SIGNAL_OF_COLUMN
from caesura_protocol.messages import Author, ForceFrame, HandOnRobot, Name, TaskName, WrenchSource
from caesura_protocol.up_direction import parse_up, up_text
from caesura_protocol.validation_words import first_finding

MEGABYTE = 1 << 20
BYTES = 512 * MEGABYTE  # of a recording
FILES = 64  # of a rosbag2's directory
UPLOADS = 4  # recordings that are held; the oldest that is not played goes
PLAYS = 2  # at a time
PLAYED = 12  # that a page lists
LOOK_S = 120.0  # for reading a recording
BUSY = "This recording is being read: wait until that is over."
MODULE = "caesura_clients.dashboard.recording_playback_process"
SUFFIXES = (".npz", ".csv", ".mcap", ".db3")
_UPLOAD = re.compile(r"[a-z0-9-]{1,64}")
_PART = re.compile(r"(?!\.)[^/\\\x00-\x1f]+")
LONGEST_NAME = 255  # [bytes] of a file or a folder, as most disks have it


def _unknown(_station: str, _session: str) -> str:
    return ""


Text = Annotated[str, StringConstraints(max_length=200)]


def _checked_up(text: str) -> str:
    """Return the direction of a text in the form of a mapping. Raises ValueError."""
    return up_text(parse_up(text))


def _checked_columns(columns: dict[str, str]) -> dict[str, str]:
    """Return the columns, by Caesura's name. Raises ValueError for an unknown name."""
    if unknown := sorted(columns.keys() - SIGNAL_OF_COLUMN.keys()):
        raise ValueError(f"{printable(unknown[0])}: Caesura has no such column")
    return columns


class Answers(BaseModel):
    """Answers of an operator about a recording; empty for a question that does not arise."""

    model_config = ConfigDict(extra="forbid")

    columns: Annotated[dict[Text, Text], AfterValidator(_checked_columns)] = Field(default={}, max_length=40)
    delimiter: Annotated[str, StringConstraints(min_length=1, max_length=1)] = ","
    decimal: Literal[".", ","] = "."
    units: dict[Text, Text] = Field(default={}, max_length=10)
    declared: dict[Text, Text] = Field(default={}, max_length=10)
    sure: bool = False
    wrench_source: WrenchSource | None = None
    hand_on_robot: HandOnRobot = "unknown"
    force_frame: ForceFrame | None = None  # as in the file
    force_of: Literal["environment", "robot"] = "environment"
    robot: Name | None = None
    up: Annotated[Text, AfterValidator(_checked_up)] | None = None


class PlayRequest(BaseModel):
    """Request to play an uploaded recording as a session of a station."""

    model_config = ConfigDict(extra="forbid")

    upload: str
    station: Name
    session: Name
    task: TaskName | None = None
    operator: Author | None = None
    answers: Answers


@dataclass(frozen=True)
class Playback:
    """Progress of a recording that is played; share: of its samples."""

    upload: str
    name: str
    station: str
    session: str
    share: float = 0.0
    opened: bool = False  # has the service opened the session?
    mapping: str = ""  # the answers as a mapping file, for a csv or a rosbag2
    warning: str = ""
    error: str = ""
    done: bool = False


class RecordingDesk:
    """Stores recordings while its context lasts.

    endpoint, config: a child process's connection to the service.
    """

    def __init__(self, endpoint: str | None, config: Path | None) -> None:
        self._endpoint, self._config = endpoint, config
        remove_abandoned()
        self._folder = UploadFolder()
        self._lock = threading.Lock()
        self._looking = threading.Lock()
        self._held: dict[str, int] = {}  # bytes by upload, the oldest first
        self._children: dict[str, subprocess.Popen[str] | None] = {}  # None: is about to start
        self._plays: dict[str, Playback] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._lock:
            children = [child for child in self._children.values() if child is not None]
        for child in children:
            child.kill()
            child.wait()
        self._folder.remove()

    # --- receiving ---

    def begin_file(self, upload: str, name: str) -> Path:
        """Return the path to which a file of an upload is written.

        Raises EditRefused for an invalid name, a file that was sent before, or an upload that is full or in
        use.
        """
        parts = name.split("/")
        for part in parts:
            if (size := len(part.encode("utf-8", "surrogatepass"))) > LONGEST_NAME:
                raise EditRefused(
                    f"{part[:40]}… has {size} bytes, expected at most {LONGEST_NAME}: rename the file."
                )
        is_name = _UPLOAD.fullmatch(upload) and len(parts) <= 2 and all(map(_PART.fullmatch, parts))
        if not is_name:
            raise EditRefused(f"{name!r} is not the name of a file, or of one in a folder.")
        with self._lock:
            if upload in self._children:
                raise EditRefused(BUSY)
            if upload not in self._held:
                self._make_room()
                self._held[upload] = 0
        path = self._folder.path / upload / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists():
            raise EditRefused(f"{name} is being received, or was received already.")
        if sum(1 for _ in (self._folder.path / upload).rglob("*")) > FILES:
            raise EditRefused(f"The folder has more than {FILES} files.")
        return path

    def count(self, upload: str, size: int) -> None:
        """Count received bytes. Beyond the limit it deletes the upload and raises EditRefused."""
        with self._lock:
            if upload not in self._held:
                raise EditRefused("The recording was removed: it is too large, or others came after it.")
            held = self._held[upload] = self._held[upload] + size
        if held > BYTES:
            self.drop(upload)
            limit = f"{BYTES // MEGABYTE} MB"
            raise EditRefused(f"The recording is larger than {limit}: play it with `caesura bridge --file`.")

    def drop(self, upload: str) -> None:
        """Delete a recording that is not being read. An unknown name deletes nothing."""
        with self._lock:
            if upload in self._children or self._held.pop(upload, None) is None:
                return
        shutil.rmtree(self._folder.path / upload, ignore_errors=True)

    def _make_room(self) -> None:
        while len(self._held) >= UPLOADS:
            idle = next((one for one in self._held if one not in self._children), None)
            if idle is None:
                raise EditRefused(f"{UPLOADS} recordings are in use: wait until one is played.")
            del self._held[idle]
            shutil.rmtree(self._folder.path / idle, ignore_errors=True)

    def _recording_of(self, upload: str) -> Path:
        """Return the file of an upload, or the directory of its rosbag2. Raises EditRefused."""
        found = sorted((self._folder.path / upload).iterdir()) if upload in self._held else []
        folders = [one for one in found if (one / "metadata.yaml").exists()]
        files = [one for one in found if one.is_file() and one.suffix.lower() in SUFFIXES]
        if len(folders) + len(files) != 1:
            named = ", ".join(one.name for one in found) or "nothing"
            raise EditRefused(
                f"{named}: expected one file ({', '.join(SUFFIXES)}), or the folder of a rosbag2 with its "
                "metadata.yaml."
            )
        return (folders or files)[0]

    # --- looking and playing ---

    def look(self, upload: str) -> dict[str, Any]:
        """Return what a recording states and leaves open; takes seconds. Raises EditRefused with a reason."""
        file = self._recording_of(upload)
        self._reserve(upload, UPLOADS)
        try:
            with self._looking:  # one after the other: each may take all the memory that one is given
                child = self._start(upload, {"do": "look", "file": str(file)})
                said, _ = child.communicate(timeout=LOOK_S)
        except subprocess.TimeoutExpired:
            child.kill()
            child.communicate()
            raise EditRefused(_not_read(file.name)) from None
        finally:
            self._ended(upload)
        answer = _last_line(said)
        if "error" in answer:
            raise EditRefused(self._in_words(answer["error"], upload))
        return {"name": file.name, **answer}

    def play(
        self, request: Mapping[str, Any], taken: frozenset[str], known: Callable[[str, str], str] = _unknown
    ) -> Playback:
        """Begin to play a recording. Raises EditRefused with a reason.

        taken: stations with a bridge. known: returns what has the name of a station's session already, as
        text; empty if nothing has.
        """
        try:
            wanted = PlayRequest.model_validate({key: one for key, one in request.items() if one != ""})
        except ValidationError as error:
            raise EditRefused(said(first_finding(error), lead="Not played")) from error
        if wanted.station in taken:
            raise EditRefused(
                f"The robot of station {wanted.station} is connected: choose another station, so that its "
                "demonstrations and this recording do not mix."
            )
        file = self._recording_of(wanted.upload)
        named = f"{wanted.station}/{wanted.session}"
        if holder := self._playing(named) or known(wanted.station, wanted.session):
            raise EditRefused(f"The session name {named} is taken by {holder}: type another session name.")
        self._reserve(wanted.upload, PLAYS)
        description = {"task": wanted.task, "operator": wanted.operator}
        job = {
            "do": "play",
            "read_s": LOOK_S,
            "file": str(file),
            "answers": wanted.answers.model_dump(),
            "description": description,
            "station": wanted.station,
            "session": wanted.session,
            "endpoint": self._endpoint,
            "config": None if self._config is None else str(self._config),
        }
        began = Playback(wanted.upload, file.name, wanted.station, wanted.session)
        self._keep(began)
        try:
            child = self._start(wanted.upload, job)
        except OSError as error:
            self._ended(wanted.upload)
            raise EditRefused(f"Not played: {error.strerror}.") from error
        threading.Thread(target=self._follow, args=(child, began), daemon=True).start()
        return began

    @property
    def plays(self) -> list[Playback]:
        """Return the last played recordings, the newest first."""
        with self._lock:
            return list(reversed(self._plays.values()))

    def _playing(self, named: str) -> str:
        """Return which recording is being played under the name of a session, as text; empty if none is."""
        with self._lock:
            one = self._plays.get(named)
        is_over = one is None or one.done or one.error
        return "" if one is None or is_over else f"the recording {one.name}, which is being played"

    def _reserve(self, upload: str, most: int) -> None:
        """Reserve the child process of an upload. Raises EditRefused if it has one, or `most` exist."""
        with self._lock:
            if upload in self._children:
                raise EditRefused(BUSY)
            if len(self._children) >= most:
                raise EditRefused(f"{len(self._children)} recordings are being played: wait for one to end.")
            self._children[upload] = None

    def _start(self, upload: str, job: Mapping[str, Any]) -> subprocess.Popen[str]:
        pipe = subprocess.PIPE
        child = subprocess.Popen(
            [sys.executable, "-m", MODULE], stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, text=True
        )
        with self._lock:
            self._children[upload] = child
        assert child.stdin is not None
        child.stdin.write(json.dumps(job))
        child.stdin.close()
        child.stdin = None  # `communicate` would flush it again
        return child

    def _ended(self, upload: str) -> None:
        with self._lock:
            self._children.pop(upload, None)

    def _follow(self, child: subprocess.Popen[str], now: Playback) -> None:
        """Read the reports of a child process until it ends."""
        assert child.stdout is not None
        with child.stdout:
            for line in child.stdout:
                said = _last_line(line)
                error, done = self._in_words(said.get("error", ""), now.upload), "done" in said
                found = {key: said[key] for key in ("share", "opened", "mapping") if key in said}
                warning = self._in_words(said.get("warning", now.warning), now.upload)
                now = replace(now, **found, warning=warning, error=error, done=done)
                if not (error or done):
                    self._keep(now)
        child.wait()
        self._ended(now.upload)  # before its end is shown: the next one may begin
        if now.done:  # what was refused can be answered anew
            self.drop(now.upload)
        elif not now.error:
            is_late = child.returncode == -signal.SIGALRM
            why = _not_read(now.name) if is_late else "The process that played it has ended."
            now = replace(now, error=why)
        self._keep(now)

    def _keep(self, one: Playback) -> None:
        with self._lock:
            self._plays[f"{one.station}/{one.session}"] = one
            while len(self._plays) > PLAYED:
                del self._plays[next(iter(self._plays))]

    def _in_words(self, error: str, upload: str) -> str:
        """Return an error of the command line for a page: without its files, and options as fields."""
        words = error.replace(f"{self._folder.path / upload}/", "")
        words = re.sub(r"^([^:]+)\.toml: ", r"\1: ", words)  # its mapping is what was chosen on the page
        words = re.sub(r'State unit = "(\w+)" for each of them$', r"Choose \1 as their unit.", words)
        return re.sub(r"--([a-z]+(?:-[a-z]+)+)", lambda option: option[1].replace("-", " "), words)


def _not_read(name: str) -> str:
    return f"{name}: not read after {LOOK_S:g} s."


def _last_line(said: str) -> dict[str, Any]:
    """Return the last JSON object of an output; an error object if there is none."""
    for line in reversed(said.splitlines()):
        try:
            found = json.loads(line)
        except ValueError:
            continue
        if isinstance(found, dict):
            return found
    return {"error": "The process that read it has ended."}
