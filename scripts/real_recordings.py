"""Check which of the recordings that data/real annotates are present, and unchanged.

    python scripts/real_recordings.py [DIRECTORY]
    python scripts/real_recordings.py --copy DIRECTORY    # also puts the annotations beside the recordings
    python scripts/real_recordings.py --counts            # what is annotated, by repository

DIRECTORY: where the recordings lie; else CAESURA_REAL_DATA, else data/real. Each annotation names
its recording, the SHA-256 of the file, the repository it comes from and its licence. The exit code is 1 where
a recording is missing or differs from the one that was annotated.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

TOP = Path(__file__).resolve().parents[1]
ANNOTATIONS = TOP / "data" / "real"
VARIABLE = "CAESURA_REAL_DATA"
SUFFIX = ".ann.json"
READ_BYTES = 1 << 20


class Wanted(NamedTuple):
    """A recording as its annotation describes it. source: repository and path in it; sha256: of the file."""

    annotation: Path
    file: str
    sha256: str
    source: str
    licence: str

    @property
    def repository(self) -> str:
        """Owner and name."""
        return self.source.partition(":")[0]

    def state(self, directory: Path) -> str:
        """Return "ok", "missing", or how the file differs from the one that was annotated."""
        path = directory / self.file
        if not path.is_file():
            return "missing"
        found = sha256_of(path)
        return (
            "ok" if found == self.sha256 else f"differs: SHA-256 {found[:12]}…, expected {self.sha256[:12]}…"
        )


def recordings(annotations: Path = ANNOTATIONS) -> Iterator[Wanted]:
    """Yield the recording of every annotation, by name. Raises KeyError where an annotation names none."""
    for path in sorted(annotations.glob(f"*{SUFFIX}")):
        named = json.loads(path.read_text(encoding="utf-8"))["recording"]
        yield Wanted(path, named["file"], named["sha256"], named["source"], named["licence"])


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(READ_BYTES):
            digest.update(block)
    return digest.hexdigest()


def directory_of(given: Path | None) -> Path:
    """Return the directory of the recordings: the argument, else the variable, else beside the repository."""
    return given or Path(os.environ.get(VARIABLE) or ANNOTATIONS)


def counts(annotations: Path = ANNOTATIONS) -> dict[str, list[float]]:
    """Count by repository: recordings, seconds, major points, optional points, seconds with a class."""
    total: dict[str, list[float]] = {}
    for wanted in recordings(annotations):
        content = json.loads(wanted.annotation.read_text(encoding="utf-8"))
        levels = [point["level"] for point in content["changepoints"]]
        row = (
            1,
            content["window"][1] - content["window"][0],
            levels.count("major"),
            levels.count("optional"),
            sum(segment["t1"] - segment["t0"] for segment in content["segments"]),
        )
        before = total.get(wanted.repository, [0.0] * len(row))
        total[wanted.repository] = [a + b for a, b in zip(before, row, strict=True)]
    return total


def main(arguments: Sequence[str] | None = None) -> int:
    """Print one line a recording. Returns 1 where one is missing or differs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("directory", type=Path, nargs="?")
    parser.add_argument("--copy", action="store_true", help="put the annotations beside the recordings")
    parser.add_argument("--counts", action="store_true", help="print what is annotated")
    options = parser.parse_args(arguments)
    if options.counts:
        print(f"{'repository':38s} recordings  seconds  major  optional  seconds with a class")
        for repository, row in counts().items():
            print("{:38s} {:10.0f} {:8.0f} {:6.0f} {:9.0f} {:10.0f}".format(repository, *row))
        return 0
    directory = directory_of(options.directory)
    states = {wanted: wanted.state(directory) for wanted in recordings()}
    for wanted, state in states.items():
        print(f"{wanted.file:22s} {state:8s} {wanted.licence}  {wanted.source}")
        if options.copy and state == "ok" and directory != ANNOTATIONS:
            shutil.copyfile(wanted.annotation, directory / wanted.annotation.name)
    absent = [wanted for wanted, state in states.items() if state != "ok"]
    print(f"{len(states) - len(absent)} of {len(states)} recordings in {directory} are as annotated")
    if absent:
        print(_advice(absent, directory))
    return 1 if absent else 0


def _advice(absent: Sequence[Wanted], directory: Path) -> str:
    repositories = sorted({wanted.repository for wanted in absent})
    return (
        f"To get the others: clone {', '.join(repositories)} from GitHub, and convert each source to npz "
        f"with the arrays t, pos, quat, force, torque, wrench_source and source_file (docs/annotation.md).\n"
        f"A file that is converted anew holds the same signals under another hash.\n"
        f"Put the files into {directory}, or name their directory: an argument, or {VARIABLE}."
    )


if __name__ == "__main__":
    sys.exit(main())
