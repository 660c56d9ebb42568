"""Annotations on disk: opened or begun, checked by the judge's reader, and replaced atomically."""

from __future__ import annotations

import hashlib
import json
import os
import re
import tempfile
from pathlib import Path
from typing import Any

from caesura_lab.annotation.editing import Document
from caesura_lab.annotations import read_annotation, truth_of
from caesura_protocol.errors import SourceError
from caesura_protocol.recording import Recording

_FLAT = re.compile(r"\{\n\s+(\"t0?\":[^{}\[\]]*?)\n\s*\}")  # a changepoint or segment: one line each
_WINDOW = re.compile(r"(\"window\": \[)\s*([^\]]*?)\s*\]")


def open_annotation(path: Path, recording: Recording, source: Path, annotator: str) -> Document:
    """Read the annotation at path, or begin one. Raises TruthError where there is one that cannot be read."""
    if not path.exists():
        return new_annotation(recording, source, annotator)
    read_annotation(path)
    document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return {"segments": [], **document}


def new_annotation(recording: Recording, source: Path, annotator: str) -> Document:
    """Return an annotation of the whole recording without any point. source: the recording's file."""
    hashed = {"sha256": hashlib.sha256(source.read_bytes()).hexdigest()} if source.is_file() else {}
    return {
        "file": source.name,
        "window": [round(float(recording.t.min()), 3), round(float(recording.t.max()), 3)],
        "wrench_source": recording.wrench_source,
        "hand_on_robot": "unknown",
        "hand_force_in_wrench": recording.wrench_source not in {"flange_sensor", "none"},
        "changepoints": [],
        "segments": [],
        "annotator": annotator,
        "note": "",
        "recording": {"file": source.name, **hashed},
    }


def save_annotation(document: Document, path: Path) -> None:
    """Write an annotation in place of the one at path, in one step.

    Raises TruthError, before anything is written, where the judge could not read it.
    Raises SourceError where the file cannot be written.
    """
    truth_of(document, str(path))
    try:
        _write(path, as_text(document))
    except OSError as error:
        raise SourceError(f"cannot write {path}: {error.strerror}") from error


def as_text(document: Document) -> str:
    """Return a document as JSON, one line a changepoint or segment."""
    text = json.dumps(document, indent=1, ensure_ascii=False)
    text = _FLAT.sub(lambda found: "{" + " ".join(found[1].split()) + "}", text)
    return _WINDOW.sub(lambda found: found[1] + " ".join(found[2].split()) + "]", text) + "\n"


def _write(path: Path, text: str) -> None:
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
