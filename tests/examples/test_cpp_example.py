"""The C++ sketch against the golden vectors: names and their order as text, its bytes where g++ is there."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest

from caesura_protocol.codec import decode, encoding_of, unpack_samples
from caesura_protocol.keys import station_key
from caesura_protocol.messages import Error, Heartbeat, SampleBatch

HERE = Path(__file__).resolve().parent
EXAMPLES = HERE.parents[1] / "examples"
VECTORS = HERE.parent / "vectors"
HEADER = (EXAMPLES / "caesura_messages.hpp").read_text(encoding="utf-8")
SKETCH = (EXAMPLES / "minimal_bridge.cpp").read_text(encoding="utf-8")


def vector(name: str) -> dict[str, Any]:
    return json.loads((VECTORS / f"{name}.json").read_text())["fields"]


def packed_names(function: str) -> list[str]:
    """The field names in the order in which a function of the header packs them."""
    body = HEADER.split(f"void {function}(")[1].split("\n}\n")[0]
    names = re.findall(r'pk\.pack\(std::string\("([^"]*)"\)\);', body)
    return [name for name in names if name not in VALUES]


VALUES = {"open", "close", "evicted", "the ring no longer has these samples"}


@pytest.mark.parametrize(
    ("function", "name", "inside"),
    [
        ("pack_open", "Control", "command"),
        ("pack_close", "Control.Close", "command"),
        ("pack_batch", "SampleBatch.float64", None),
        ("pack_heartbeat", "Heartbeat", None),
    ],
)
def test_names_and_their_order_are_those_of_the_vectors(function, name, inside):
    fields = vector(name)
    expected = [inside, *fields[inside]] if inside else list(fields)
    assert packed_names(function) == expected
    body = HEADER.split(f"void {function}(")[1].split("\n}\n")[0]
    sizes = [int(size) for size in re.findall(r"pack_map\((\d+)\)", body)]
    assert sizes == ([1, len(fields[inside])] if inside else [len(fields)])


def test_keys_and_encodings_are_those_of_caesura():
    assert 'return "caesura/v1/station/" + station + "/" + part;' in HEADER
    assert station_key("cell-1", "samples") == "caesura/v1/station/cell-1/samples"
    assert '"application/msgpack;caesura." + type + ".v1"' in HEADER
    assert encoding_of(SampleBatch) == "application/msgpack;caesura.SampleBatch.v1"
    used = set(re.findall(r'key\("([a-z]+)"\)', SKETCH))
    assert used == {"alive", "replay", "samples", "control"}
    types = set(re.findall(r'encoding_of\("([A-Za-z]+)"\)', SKETCH))
    assert types == {"SampleBatch", "Control", "Error"}


MAIN = """
#include <cstdio>
#include "msgpack_stand_in.hpp"
#include "caesura_messages.hpp"
void show(const StandIn& pk) {
    for (unsigned char byte : pk.bytes) std::printf("%02x", byte);
    std::printf("\\n");
}
int main() {
    caesura::Opening opening;
    opening.session = "SESSION";
    opening.columns = {"t", "px", "py", "pz", "fx", "fy", "fz"};
    opening.wrench_source = "flange_sensor";
    opening.hand_on_robot = "yes";
    opening.bridge = "robot-1-4711-58af";
    opening.up = {0.0, 0.0, -1.0};
    opening.task = "pick and place";
    opening.operator_name = "Ann";
    { StandIn pk; caesura::pack_open(pk, opening); show(pk); }
    { StandIn pk; caesura::pack_close(pk, opening, 624, true); show(pk); }
    { StandIn pk; caesura::pack_heartbeat(pk, opening, 17); show(pk); }
    std::vector<float> small = {ROWS};
    { StandIn pk; caesura::pack_batch(pk, opening, 17, 12.5, small); show(pk); }
    std::vector<double> large = {ROWS};
    { StandIn pk; caesura::pack_batch(pk, opening, 17, 12.5, large); show(pk); }
    { StandIn pk; caesura::pack_evicted(pk, 3, 40); show(pk); }
    { StandIn pk; caesura::pack_heartbeat(pk, opening, -1); show(pk); }
}
"""


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> list[bytes]:
    """What the header writes, line by line of MAIN."""
    compiler = shutil.which("g++") or shutil.which("clang++")
    if compiler is None:
        pytest.skip("no C++ compiler")
    directory = tmp_path_factory.mktemp("cpp")
    batch = decode(
        (VECTORS / "SampleBatch.float32.msgpack").read_bytes(), encoding_of(SampleBatch), SampleBatch
    )
    matrix = unpack_samples(batch)
    matrix[:, 0] -= batch.t0
    rows = ", ".join(map(repr, np.ravel(matrix).tolist()))
    (directory / "main.cpp").write_text(MAIN.replace("ROWS", rows).replace("SESSION", batch.session))
    program = directory / "main"
    flags = ["-std=c++17", "-Wall", "-Wextra", "-Werror", f"-I{EXAMPLES}", f"-I{HERE}"]
    subprocess.run([compiler, *flags, str(directory / "main.cpp"), "-o", str(program)], check=True)
    said = subprocess.run([str(program)], check=True, capture_output=True, text=True).stdout
    return [bytes.fromhex(line) for line in said.splitlines()]


def test_the_bytes_are_those_of_the_golden_vectors(written):
    names = ("Control", "Control.Close", "Heartbeat", "SampleBatch.float32", "SampleBatch.float64")
    for name, found in zip(names, written, strict=False):
        assert found == (VECTORS / f"{name}.msgpack").read_bytes(), name


def test_what_has_no_vector_of_its_own_is_read_all_the_same(written):
    refusal = decode(written[5], encoding_of(Error), Error)
    assert (refusal.code, refusal.value, refusal.limit) == ("evicted", 3, 40)
    assert decode(written[6], encoding_of(Heartbeat), Heartbeat).seq == -1
    assert list(msgpack.unpackb(written[5])) == ["code", "message", "value", "limit"]
