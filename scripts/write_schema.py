"""Write the JSON Schema of every message beside the models.

    python scripts/write_schema.py           # writes protocol/caesura_protocol/schema
    python scripts/write_schema.py --check   # exits 1 where a file differs from the models

A schema describes the msgpack map: `bytes` is a msgpack bin, which JSON has no word for.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from caesura_protocol.codec import MESSAGE_TYPES, encoding_of
from caesura_protocol.messages import MAX_MESSAGE_BYTES, Message

SCHEMA = Path(__file__).resolve().parents[1] / "protocol" / "caesura_protocol" / "schema"
DIALECT = "https://json-schema.org/draft/2020-12/schema"


class WireSchema(GenerateJsonSchema):
    """Describes what stands in msgpack, not what JSON would make of it."""

    def bytes_schema(self, schema: core_schema.BytesSchema) -> JsonSchemaValue:
        """Describe a msgpack bin; no JSON value matches it, so a validator must be taught the type."""
        return {
            "$comment": "msgpack bin, not a string",
            "type": "string",
            "contentEncoding": "binary",
            "maxLength": schema.get("max_length", MAX_MESSAGE_BYTES),
        }


def files() -> dict[str, str]:
    """Name and content of every schema file."""
    return {f"{name}.json": _described(model) for name, model in sorted(MESSAGE_TYPES.items())}


def _described(model: type[Message]) -> str:
    schema = model.model_json_schema(mode="validation", schema_generator=WireSchema)
    head = {"$schema": DIALECT, "$id": f"caesura.{model.__name__}.v1", "encoding": encoding_of(model)}
    return json.dumps(head | schema, indent=2, ensure_ascii=False) + "\n"


def main() -> int:
    """Write or check; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true")
    wanted = files()
    known = {path.name: path.read_text(encoding="utf-8") for path in SCHEMA.glob("*.json")}
    if parser.parse_args().check:
        drifted = sorted(name for name in wanted | known if wanted.get(name) != known.get(name))
        if drifted:
            print(f"schema differs from the models: {', '.join(drifted)}; run scripts/write_schema.py")
        return int(bool(drifted))
    SCHEMA.mkdir(exist_ok=True)
    for stale in known.keys() - wanted.keys():
        (SCHEMA / stale).unlink()
    for name, content in wanted.items():
        (SCHEMA / name).write_text(content, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
