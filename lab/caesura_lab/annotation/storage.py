"""Annotations on disk: opened or created, validated by the judge's reader, and replaced atomically."""

from __future__ import annotations

import json
import os
import re
import tempfile
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any

from caesura_lab.annotation.edits import Document, milliseconds
from caesura_lab.ground_truth import SUFFIX, RecordingSource, TruthError, read_annotation, sha256_of, truth_of
from caesura_protocol.errors import SourceError
from caesura_protocol.recording import Recording

_FLAT = re.compile(r"\{\n\s+(\"t0?\":[^{}\[\]]*?)\n\s*\}")  # a changepoint or segment: one line each
_WINDOW = re.compile(r"(\"window\": \[)\s*([^\]]*?)\s*\]")


def open_annotation(path: Path, recording: Recording, source: Path, annotator: str) -> Document:
    """Read the annotation at path, or create one.

    Raises TruthError if an existing one cannot be read, or was made for another recording.
    """
    if not path.exists():
        return new_annotation(recording, source, annotator)
    truth = read_annotation(path)
    if truth.source is not None and source.is_file():
        _check_recording(path, truth.source, source)
    document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return {"segments": [], **document}


def _check_recording(path: Path, annotated: RecordingSource, source: Path) -> None:
    found = sha256_of(source)
    if found != annotated.sha256:
        raise TruthError(
            f"{path}: made for {annotated.file} with SHA-256 {annotated.sha256}, and {source.name} has "
            f"{found}; begin another with --out FILE.ann.json, or move this one away"
        )


def new_annotation(recording: Recording, source: Path, annotator: str) -> Document:
    """Return an annotation of the whole recording without any point.

    source: the recording's file, or a bag's directory, which has no hash.
    """
    hashed = {"recording": {"file": source.name, "sha256": sha256_of(source)}} if source.is_file() else {}
    return {
        "file": source.name,
        "window": [milliseconds(float(recording.t.min())), milliseconds(float(recording.t.max()))],
        "wrench_source": recording.wrench_source,
        "hand_on_robot": recording.hand_on_robot,
        "hand_force_in_wrench": _hand_in_wrench(recording),
        "changepoints": [],
        "segments": [],
        "annotator": annotator,
        "note": "",
        **hashed,
    }


def _hand_in_wrench(recording: Recording) -> bool | None:
    """Return whether the force contains the guiding hand; None where the source is not stated."""
    if recording.wrench_source == "joint_torque_estimate":
        return recording.hand_on_robot != "no"
    stated = {"flange_sensor": False, "none": False, "flange_sensor_with_hand": True}
    return stated.get(recording.wrench_source or "")


def check_writable(path: Path) -> None:
    """Check that an annotation can be saved, before one is made. Raises SourceError."""
    if path.is_dir():
        raise SourceError(f"cannot write {path}: it is a directory, expected FILE{SUFFIX}")
    if not path.parent.is_dir():
        raise SourceError(f"cannot write {path}: no such directory")
    if not os.access(path.parent, os.W_OK):
        raise SourceError(f"cannot write {path}: {path.parent} is read-only; name another file with --out")


def save_annotation(document: Document, path: Path) -> None:
    """Replace the annotation at path atomically.

    Raises TruthError, before anything is written, where the judge could not read it. Raises SourceError where
    the file cannot be written.
    """
    truth_of(document, str(path))
    _write(path, as_text(document))


def save_draft(document: Document, path: Path) -> Path:
    """Write an unsaved annotation to a new file beside path, and return that path.

    Raises SourceError where it cannot be written.
    """
    draft = next(one for one in drafts(path) if not one.exists())
    _write(draft, as_text(document))
    return draft


def drafts(path: Path) -> Iterator[Path]:
    """Yield the paths of drafts of the annotation at path, without end."""
    return (path.with_name(f"{path.name}.unsaved{'' if n == 1 else f'-{n}'}") for n in count(1))


def as_text(document: Document) -> str:
    """Return a document as JSON, with one line per changepoint or segment."""
    text = json.dumps(document, indent=1, ensure_ascii=False)
    text = _FLAT.sub(lambda found: "{" + " ".join(found[1].split()) + "}", text)
    return _WINDOW.sub(lambda found: found[1] + " ".join(found[2].split()) + "]", text) + "\n"


def _write(path: Path, text: str) -> None:
    """Replace a file atomically. Raises SourceError where it cannot be written."""
    try:
        _replace(path, text)
    except OSError as error:
        raise SourceError(f"cannot write {path}: {error.strerror}") from error


def _replace(path: Path, text: str) -> None:
    with tempfile.NamedTemporaryFile(
        "w", encoding="utf-8", dir=path.parent, prefix=f".{path.name}.", delete=False
    ) as file:
        try:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
            os.chmod(file.name, path.stat().st_mode if path.exists() else 0o644)
            os.replace(file.name, path)
        except BaseException:
            os.unlink(file.name)
            raise
