"""docs/recordings.md, docs/robots.md and docs/api.md against the code."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import pytest

from caesura_clients.bridge.sources.registry import SOURCES
from caesura_protocol.errors import ERROR_CODES
from caesura_protocol.formats.csv_read_mapped import UNITS, rules_of
from caesura_protocol.formats.mapping_file_read import ColumnMapping, load_mapping
from caesura_protocol.formats.ros_messages import topic_rules
from caesura_protocol.formats.ros_types import FRANKA_HASH, READ
from caesura_protocol.keys import ServicePart, SessionPart, StationPart
from caesura_protocol.messages import COLUMNS_OF_SIGNAL

DOCS = Path(__file__).resolve().parents[2] / "docs"
RECORDINGS, ROBOTS, API = ((DOCS / name).read_text() for name in ("recordings.md", "robots.md", "api.md"))
BLOCKS = re.findall(r"```toml\n(.*?)```", RECORDINGS, re.DOTALL)


@pytest.fixture(params=BLOCKS, ids=["csv", "ros2"])
def mapped(request, tmp_path) -> ColumnMapping:
    (tmp_path / "map.toml").write_text(request.param)
    return load_mapping(tmp_path / "map.toml")


def test_the_mappings_are_read(mapped):
    options = {"wrench_source": "flange_sensor", "hand_on_robot": "yes", "force_frame": "flange"}
    if mapped.section("columns"):
        options |= {"force_frame": "base", "robot": "panda", "up": "0,0,1"}
    assert mapped.options == options
    if mapped.section("columns"):
        assert {rule.column: rule.factor for rule in rules_of(mapped)} == pytest.approx(
            {"t": 1e-3, "px": 1e-3, "py": 1e-3, "pz": 1e-3, "fx": 1.0, "fy": 1.0, "fz": -1.0}
        )
    else:
        rules = topic_rules(mapped)
        assert len(rules) == 4
        assert rules["/pedal"].mark


def test_units_types_and_the_version_are_those_of_the_code():
    for units in UNITS.values():
        for unit in units:
            assert unit == "1" or re.search(rf"\b{unit}\b", RECORDINGS), unit
    for name in READ:
        assert f"`{name}`" in RECORDINGS
    assert FRANKA_HASH[:15] in RECORDINGS


def test_every_source_is_in_the_table():
    named = {name for row in ROBOTS.splitlines() if row.startswith("| `") for name in CODE.findall(row[:40])}
    assert set(SOURCES) <= named


CODE = re.compile(r"`([a-z0-9_]+)`")


def test_every_key_and_every_refusal_is_in_the_api():
    for part in get_args(StationPart):
        assert f"`caesura/v1/station/{{station}}/{part}`" in API
    for part in get_args(SessionPart):
        assert f"`caesura/v1/session/{{station}}/{{session}}/{part}`" in API
    for part in get_args(ServicePart):
        assert f"`caesura/v1/service/{{instance}}/{part}`" in API
    for code in ERROR_CODES:
        assert f"| `{code}` |" in API
    for names in COLUMNS_OF_SIGNAL.values():
        first = names[0]
        assert re.search(rf"`{first}\b|{first}…", API), first
