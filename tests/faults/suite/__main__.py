"""`python -m faults.suite [NAME…]`: does what the table names, a row each; exits 1 where a bar fails."""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
import traceback
from pathlib import Path

from rich.console import Console
from rich.table import Table

from faults.suite.outcome import FaultCase, Row
from faults.suite.table import FAULTS

CONSOLE = Console(width=170)


def main() -> int:
    """The exit code."""
    parser = argparse.ArgumentParser(prog="make faults", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="parts of names of faults; by default all")
    parser.add_argument("--list", action="store_true", help="name them")
    options = parser.parse_args()
    chosen = [
        fault for fault in FAULTS if not options.names or any(part in fault.name for part in options.names)
    ]
    if not chosen:
        parser.error(f"no such fault: {options.names}; there are: {', '.join(f.name for f in FAULTS)}")
    if options.list:
        CONSOLE.print("\n".join(fault.name for fault in chosen))
        return 0
    began = time.monotonic()
    rows = [(fault, row) for fault in chosen for row in carried_out(fault)]
    CONSOLE.print(table(rows))
    failed = [fault.name for fault, row in rows if not row.met]
    CONSOLE.print(f"{len(rows)} rows in {time.monotonic() - began:.0f} s; bars failed: {failed or 'none'}")
    return 1 if failed else 0


def carried_out(fault: FaultCase) -> list[Row]:
    """Its rows; one that breaks is a row that fails."""
    began = time.monotonic()
    CONSOLE.print(f"{fault.name} …", end=" ")
    try:
        with tempfile.TemporaryDirectory() as directory:
            rows = fault.run(Path(directory))
    except Exception as error:
        traceback.print_exc()
        rows = Row(0, 0, 0, 0, "no", None, f"broke: {type(error).__name__}: {error}", met=False)
    rows = rows if isinstance(rows, list) else [rows]
    CONSOLE.print(f"{'ok' if all(row.met for row in rows) else 'FAILED'}, {time.monotonic() - began:.0f} s")
    return rows


def table(rows: list[tuple[FaultCase, Row]]) -> Table:
    """One row a fault."""
    shown = Table("fault", "sessions", "sent", "lost", "doubled", "equal", "recovery [s]", "bar", "note")
    for fault, row in rows:
        recovery = "–" if row.recovery_s is None else f"{row.recovery_s:.2f}"
        counts = (str(row.sessions), str(row.sent), str(row.lost), str(row.duplicated))
        shown.add_row(fault.name, *counts, row.equal, recovery, "met" if row.met else "FAILED", row.note)
    return shown


if __name__ == "__main__":
    sys.exit(main())
