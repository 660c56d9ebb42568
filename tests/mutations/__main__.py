"""`python -m mutations [WORD…]`: breaks the code in one place at a time; the tests named must notice.

With `--rows` the row of `make faults` that the table names must notice, which takes minutes for each.

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
SOURCES = ("service", "protocol", "clients", "lab")
COPIED = (*SOURCES, "tests", "data", "scripts", "pyproject.toml")
PASSED, FAILED = 0, 1  # pytest's exit codes
DEADLINE_S = 120.0  # of the tests of one mutation
ROW_DEADLINE_S = 600.0
SHOWN = 200  # characters of what a row says
CONSOLE = Console(width=150)


def main() -> int:
    """The exit code."""
    parser = argparse.ArgumentParser(prog="make mutations", description=__doc__)
    parser.add_argument(
        "words", nargs="*", metavar="WORD", help="only those whose names contain one of these"
    )
    parser.add_argument("--rows", action="store_true", help="by rows of `make faults`, not by tests")
    options = parser.parse_args()
    words = options.words
    chosen = [
        one
        for one in MUTATIONS
        if (one.row or not options.rows) and (not words or any(word in one.name for word in words))
    ]
    if not chosen:
        parser.error(f"no mutation has one of {words} in its name")
    with tempfile.TemporaryDirectory() as directory:
        copy = Path(directory)
        for name in COPIED:
            (shutil.copytree if (ROOT / name).is_dir() else shutil.copy)(ROOT / name, copy / name)
        check(copy, chosen, with_tests=not options.rows)
        shown, survived = Table("mutation", "file", "caught by", "time [s]"), 0
        for mutation in chosen:
            began = time.monotonic()
            caught_by = tried(copy, mutation, by_row=options.rows)
            survived += caught_by is None
            took = f"{time.monotonic() - began:.1f}"
            shown.add_row(mutation.name, Path(mutation.file).name, caught_by or "NOT CAUGHT", took)
            CONSOLE.print(f"{mutation.name}: {'caught' if caught_by else 'NOT CAUGHT'}")
    CONSOLE.print(shown)
    CONSOLE.print(f"{len(chosen)} mutations, {survived} not caught")
    return 1 if survived else 0


def check(copy: Path, chosen: list[Mutation], *, with_tests: bool) -> None:
    """The copy is what is tested, and its tests pass as it is. Raises RuntimeError."""
    imported = "import caesura_service; print(caesura_service.__file__)"
    where = run(copy, "-c", imported).stdout.strip()
    if not Path(where).is_relative_to(copy):
        raise RuntimeError(f"the tests would import {where}, expected a file below {copy}")
    for mutation in chosen:
        mutated(copy, mutation)
    run(copy, "-m", "caesura_service.prepare", deadline_s=ROW_DEADLINE_S)  # compiles, in no test's time
    if not with_tests:
        return
    tests = dict.fromkeys(test for one in chosen for test in one.tests)
    ended = run(copy, *pytest(tests), deadline_s=DEADLINE_S * len(chosen))
    if ended.returncode != PASSED:
        raise RuntimeError(f"the tests do not pass before anything is mutated:\n{ended.stdout}{ended.stderr}")


def tried(copy: Path, mutation: Mutation, *, by_row: bool) -> str | None:
    """The first test, or the row, that fails; None where all pass. Raises RuntimeError for neither."""
    file = copy / mutation.file
    whole = file.read_text()
    file.write_text(mutated(copy, mutation))
    try:
        if by_row and mutation.row:
            ended = run(copy, "-m", "faults.suite", mutation.row, deadline_s=ROW_DEADLINE_S)
        else:
            ended = run(copy, *pytest(mutation.tests))
    finally:
        file.write_text(whole)
    if ended.returncode not in {PASSED, FAILED}:
        raise RuntimeError(f"{mutation.name}: pytest broke:\n{ended.stdout}{ended.stderr}")
    if by_row:
        said = ended.stdout.partition("wrong: ")[2] or ended.stderr[-SHOWN:]
        return None if ended.returncode == PASSED else f"{mutation.row}: {' '.join(said.split())[:SHOWN]}"
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


def run(copy: Path, *arguments: str, deadline_s: float = DEADLINE_S) -> subprocess.CompletedProcess[str]:
    """Python in the copy. Raises TimeoutExpired."""
    path = os.pathsep.join(str(copy / name) for name in (*SOURCES, "tests"))
    environment = {**os.environ, "PYTHONPATH": path}
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=copy,
        env=environment,
        capture_output=True,
        text=True,
        timeout=deadline_s,
        check=False,
    )


if __name__ == "__main__":
    sys.exit(main())
