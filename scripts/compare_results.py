"""Compare the results of every recording and preset with those of another commit.

    python scripts/compare_results.py --write FILE [--presets default …]    # results of this checkout
    python scripts/compare_results.py --against FILE                        # what differs: exit code 1

A refactoring keeps every result to the last bit. A change of behaviour keeps the printed list.
Write the file in a checkout of the commit before, `git worktree add DIRECTORY COMMIT`, then compare here.
The recordings are those of data/ and of CAESURA_REAL_DATA, by default ../shared/data/real.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

from caesura_protocol.errors import CaesuraError, ProtocolError
from caesura_protocol.formats.read import load_recording
from caesura_service.changepoint.presets import PRESETS
from caesura_service.offline_segmentation import as_json, segment_recording
from caesura_service.prepare import prepare
from real_recordings import directory_of

TOP = Path(__file__).resolve().parents[1]
SHOWN = 3  # differences of one result that are printed

Results = dict[str, dict[str, Any]]


def recordings() -> list[Path]:
    """Every recording, those of the repository first."""
    return [*sorted((TOP / "data").glob("*.npz")), *sorted(directory_of(None).rglob("*.npz"))]


def results(presets: Sequence[str]) -> Results:
    """Segment every recording with every preset; a refusal is a result too."""
    found: Results = {}
    for path in recordings():
        for preset in presets:
            try:
                view = as_json(segment_recording(load_recording(path), preset))
            except (CaesuraError, ProtocolError, ValueError) as error:
                view = {"refused": str(error)}
            found[f"{path.name} {preset}"] = json.loads(json.dumps(view))
    return found


def differences(before: Any, after: Any, place: str = "") -> Iterator[str]:
    """Yield each value that differs, by its place in the result."""
    if isinstance(before, Mapping) and isinstance(after, Mapping):
        for key in sorted(before.keys() | after.keys()):
            yield from differences(before.get(key), after.get(key), f"{place}.{key}" if place else key)
    elif isinstance(before, list) and isinstance(after, list):
        for index, (one, other) in enumerate(zip_longest(before, after)):
            yield from differences(one, other, f"{place}[{index}]")
    elif before != after:
        yield f"{place}: {before!r:.60} → {after!r:.60}"


def compare(before: Results, after: Results) -> int:
    """Print what differs; return how many results do."""
    changed = 0
    for name in sorted(before.keys() & after.keys()):
        found = list(differences(before[name], after[name]))
        if found:
            changed += 1
            print(f"{name}: {len(found)} values differ")
            for line in found[:SHOWN]:
                print(f"  {line}")
    for name in sorted(before.keys() ^ after.keys()):
        print(f"{name}: only {'before' if name in before else 'after'}")
    print(f"{changed} of {len(before.keys() & after.keys())} results differ")
    return changed


def main(arguments: Sequence[str] | None = None) -> int:
    """Write or compare; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--write", type=Path, metavar="FILE")
    what.add_argument("--against", type=Path, metavar="FILE")
    parser.add_argument("--presets", nargs="+", default=["default", "strokes", "integrated"], choices=PRESETS)
    asked = parser.parse_args(arguments)
    prepare()  # code compiled in this process may round otherwise than code from the cache
    if asked.write:
        asked.write.write_text(json.dumps(results(asked.presets)), encoding="utf-8")
        return 0
    before = json.loads(asked.against.read_text(encoding="utf-8"))
    presets = sorted({name.rpartition(" ")[2] for name in before})
    return int(compare(before, results(presets)) > 0)


if __name__ == "__main__":
    sys.exit(main())
