"""The bytes on the wire are a promise to bridges in other languages."""

import base64
import json
import re
import subprocess
import sys
from pathlib import Path

import msgpack
import pytest
from jsonschema import Draft202012Validator
from jsonschema.validators import extend

from caesura_protocol.codec import MESSAGE_TYPES, decode, encode, encoding_of, unpack_samples
from caesura_protocol.messages import SampleBatch

ROOT = Path(__file__).resolve().parents[2]
VECTORS = sorted((ROOT / "tests" / "vectors").glob("*.json"))
SCHEMA = ROOT / "protocol" / "caesura_protocol" / "schema"

# The schemas describe msgpack, in which a bin is a value of its own and an array may be read as a tuple.
WIRE_TYPES = Draft202012Validator.TYPE_CHECKER.redefine(
    "array", lambda _, value: isinstance(value, list | tuple)
).redefine("string", lambda _, value: isinstance(value, str | bytes))
WireValidator = extend(Draft202012Validator, type_checker=WIRE_TYPES)


def described(path):
    fields = json.loads(path.read_text(encoding="utf-8"), object_hook=plain)
    return fields, path.with_suffix(".msgpack").read_bytes()


def plain(fields):
    return base64.b64decode(fields["base64"]) if set(fields) == {"base64"} else fields


def test_every_message_has_a_vector():
    assert {json.loads(path.read_text())["type"] for path in VECTORS} == set(MESSAGE_TYPES)


@pytest.mark.parametrize("path", VECTORS, ids=lambda path: path.stem)
def test_a_vector_is_read_and_written_byte_for_byte(path):
    vector, payload = described(path)
    model = MESSAGE_TYPES[vector["type"]]
    message = decode(payload, vector["encoding"], model)
    assert encode(message) == (payload, vector["encoding"])
    assert message == model.model_validate(vector["fields"])


@pytest.mark.parametrize("path", VECTORS, ids=lambda path: path.stem)
def test_a_vector_meets_the_schema(path):
    vector, payload = described(path)
    schema = json.loads((SCHEMA / f"{vector['type']}.json").read_text(encoding="utf-8"))
    WireValidator(schema).validate(msgpack.unpackb(payload))


@pytest.mark.parametrize("name", MESSAGE_TYPES)
def test_a_schema_is_valid_and_names_its_encoding(name):
    schema = json.loads((SCHEMA / f"{name}.json").read_text(encoding="utf-8"))
    Draft202012Validator.check_schema(schema)
    assert schema["encoding"] == encoding_of(MESSAGE_TYPES[name])


@pytest.mark.parametrize("size", ["float32", "float64"])
def test_both_float_sizes_say_the_same(size):
    vector, payload = described(ROOT / "tests" / "vectors" / f"SampleBatch.{size}.json")
    matrix = unpack_samples(decode(payload, vector["encoding"], SampleBatch))
    assert matrix[:, 0].tolist() == [12.5, 12.5009765625, 12.501953125]
    assert matrix[:, -1].tolist() == [-9.5, -9.25, -9.0]


def test_the_layout_in_the_readme_is_the_one_on_disk():
    text = (ROOT / "tests" / "vectors" / "README.md").read_text(encoding="utf-8")
    payload = (ROOT / "tests" / "vectors" / "SampleBatch.float32.msgpack").read_bytes()
    assert payload[0] == 0x88
    t0 = re.search(r"`a2` \"t0\" `cb ([0-9a-f]{16})`", text)[1]
    assert b"\xa2t0\xcb" + bytes.fromhex(t0) in payload
    assert b"\xa7samples\xc4\x54" in payload


@pytest.mark.parametrize("script", ["write_vectors.py", "write_schema.py"])
def test_files_are_in_step_with_the_models(script):
    ran = subprocess.run(
        [sys.executable, ROOT / "scripts" / script, "--check"], capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stdout
