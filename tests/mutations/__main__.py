"""`python -m mutations [WORD…]`: breaks the code in one place at a time; the tests named must notice.

Everything happens in a temporary copy of the sources, which is first on the path of the tests and of their
children. A mutation is caught where a test fails, and not where pytest finds no test or breaks. Exits 1 where
one survives.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path

from rich.console import Console
from rich.table import Table

from mutations.table import MUTATIONS, Mutation

ROOT = Path(__file__).parents[2]
SOURCES = ("service", "protocol", "clients")
COPIED = (*SOURCES, "tests", "data", "scripts", "pyproject.toml")
PASSED, FAILED = 0, 1  # pytest's exit codes
DEADLINE_S = 120.0  # of the tests of one mutation
CONSOLE = Console(width=150)


def main() -> int:
    """The exit code."""
    parser = argparse.ArgumentParser(prog="make mutations", description=__doc__)
    parser.add_argument(
        "words", nargs="*", metavar="WORD", help="only those whose names contain one of these"
    )
    words = parser.parse_args().words
    chosen = [one for one in MUTATIONS if not words or any(word in one.name for word in words)]
    if not chosen:
        parser.error(f"no mutation has one of {words} in its name")
    with tempfile.TemporaryDirectory() as directory:
        copy = Path(directory)
        for name in COPIED:
            (shutil.copytree if (ROOT / name).is_dir() else shutil.copy)(ROOT / name, copy / name)
        check(copy, chosen)
        shown, survived = Table("mutation", "file", "caught by", "time [s]"), 0
        for mutation in chosen:
            began = time.monotonic()
            caught_by = tried(copy, mutation)
            survived += caught_by is None
            took = f"{time.monotonic() - began:.1f}"
            shown.add_row(mutation.name, Path(mutation.file).name, caught_by or "NOT CAUGHT", took)
            CONSOLE.print(f"{mutation.name}: {'caught' if caught_by else 'NOT CAUGHT'}")
    CONSOLE.print(shown)
    CONSOLE.print(f"{len(chosen)} mutations, {survived} not caught")
    return 1 if survived else 0


def check(copy: Path, chosen: list[Mutation]) -> None:
    """The copy is what is tested, and its tests pass as it is. Raises RuntimeError."""
    imported = "import caesura_service; print(caesura_service.__file__)"
    where = run(copy, "-c", imported).stdout.strip()
    if not Path(where).is_relative_to(copy):
        raise RuntimeError(f"the tests would import {where}, expected a file below {copy}")
    for mutation in chosen:
        mutated(copy, mutation)
    ended = run(copy, *pytest(dict.fromkeys(test for one in chosen for test in one.tests)))
    if ended.returncode != PASSED:
        raise RuntimeError(f"the tests do not pass before anything is mutated:\n{ended.stdout}{ended.stderr}")


def tried(copy: Path, mutation: Mutation) -> str | None:
    """The first test that fails; None where all pass. Raises RuntimeError where pytest says neither."""
    file = copy / mutation.file
    whole = file.read_text()
    file.write_text(mutated(copy, mutation))
    try:
        ended = run(copy, *pytest(mutation.tests))
    finally:
        file.write_text(whole)
    if ended.returncode not in {PASSED, FAILED}:
        raise RuntimeError(f"{mutation.name}: pytest broke:\n{ended.stdout}{ended.stderr}")
    failed = [line for line in ended.stdout.splitlines() if line.startswith("FAILED")]
    return failed[0].split("::")[1].split(" ")[0].split("[")[0] if failed else None


def mutated(copy: Path, mutation: Mutation) -> str:
    """The file's new content. Raises RuntimeError where the text is not in it exactly once."""
    whole = (copy / mutation.file).read_text()
    if (count := whole.count(mutation.text)) != 1:
        why = f"{mutation.file} has the text {count} times, expected once: {mutation.text!r}"
        raise RuntimeError(f"{mutation.name}: {why}")
    return whole.replace(mutation.text, mutation.replacement)


def pytest(tests: Iterable[str]) -> list[str]:
    """The command line."""
    options = ["-x", "-q", "-rf", "-p", "no:cacheprovider", "--no-header", "--hypothesis-profile=unshrunk"]
    return ["-m", "pytest", *options, *tests]


def run(copy: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Python in the copy. Raises TimeoutExpired."""
    path = os.pathsep.join(str(copy / name) for name in (*SOURCES, "tests"))
    environment = {**os.environ, "PYTHONPATH": path}
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=copy,
        env=environment,
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
        check=False,
    )


if __name__ == "__main__":
    sys.exit(main())
