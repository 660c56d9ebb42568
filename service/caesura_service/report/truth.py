"""What really happened, as an annotation beside a recording tells it.

    {"changepoints": [{"t": 1.79, "tol": 0.15, "kind": "contact_on", "level": "major"}, …],
     "segments": [{"t0": 0.0, "t1": 1.79, "cls": "motion"}, …]}

Boundaries of level `optional` count neither as missed nor as false. Stretches without a class are unclear.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from caesura_clients.errors import CaesuraError

SUFFIX = ".ann.json"


class TruthError(CaesuraError):
    """The file is no annotation; the message names the file and what was expected."""


@dataclass(frozen=True)
class Boundary:
    """Where somebody, or the simulation, says that a segment begins."""

    t: float  # [s]
    optional: bool


@dataclass(frozen=True)
class Labelled:
    """A stretch of known class."""

    t0: float  # [s]
    tn: float  # [s]
    kind: str


@dataclass(frozen=True)
class Truth:
    """What a recording is held against."""

    boundaries: tuple[Boundary, ...]
    labelled: tuple[Labelled, ...]


def annotation_beside(recording: Path) -> Path | None:
    """The annotation that lies beside a recording, if one does."""
    beside = recording.with_suffix(SUFFIX)
    return beside if beside.is_file() else None


def load_truth(path: Path) -> Truth:
    """Read an annotation. Raises TruthError for anything else."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return _truth(content)
    except OSError as error:
        raise TruthError(f"{path}: {error.strerror}") from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise TruthError(f"{path}: not an annotation ({type(error).__name__}: {error})") from error


def _truth(content: dict[str, Any]) -> Truth:
    return Truth(
        boundaries=tuple(
            Boundary(float(one["t"]), one.get("level") == "optional") for one in content["changepoints"]
        ),
        labelled=tuple(
            Labelled(float(one["t0"]), float(one["t1"]), str(one["cls"])) for one in content["segments"]
        ),
    )
