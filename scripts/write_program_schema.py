"""Write the JSON Schema of a task program's file beside its model.

python scripts/write_program_schema.py           # writes protocol/caesura_protocol/programs/schema
python scripts/write_program_schema.py --check   # exits 1 where the file differs from the model
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from caesura_protocol.programs.document import VERSION, ProgramFile

DIALECT = "https://json-schema.org/draft/2020-12/schema"
PROGRAMS = Path(__file__).resolve().parents[1] / "protocol" / "caesura_protocol" / "programs"
FILE = PROGRAMS / "schema" / f"program.v{VERSION}.json"


def content() -> str:
    """The schema's text."""
    head = {"$schema": DIALECT, "$id": f"caesura.program.v{VERSION}"}
    schema = head | ProgramFile.model_json_schema(mode="validation")
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def main() -> int:
    """Write or check; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true")
    if parser.parse_args().check:
        drifted = not FILE.is_file() or FILE.read_text(encoding="utf-8") != content()
        if drifted:
            print(f"{FILE.name} differs from the model; run scripts/write_program_schema.py")
        return int(drifted)
    FILE.parent.mkdir(exist_ok=True)
    FILE.write_text(content(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
