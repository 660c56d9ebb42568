"""docs/queues.md says of every queue what its bound is; here it is held against the code."""

from __future__ import annotations

import json
import re
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
import zenoh

from caesura_protocol import messages

ROOT = Path(__file__).parents[2]
TABLE = [line for line in (ROOT / "docs" / "queues.md").read_text().splitlines() if line.startswith("| ")][1:]
BOUND = re.compile(r"`([a-z0-9_/]+):([A-Za-z_./0-9]+)` = ([0-9.]+)(?: (MiB|GB))?")
PLACE = re.compile(r"\(?`([a-z0-9_]+(?:/[a-z0-9_]+)*)`")
UNITS = {None: 1, "MiB": 1 << 20, "GB": 10**9}
QUEUE = re.compile(r"\b(?:deque|Inbox|WorkQueue|SimpleQueue|Queue|LifoQueue|FifoChannel|RingChannel)\(")
PACKAGES = {name: f"caesura_{name}" for name in ("protocol", "service", "clients", "lab")}


def bounds() -> list[tuple[str, str, float]]:
    return [
        (place, name, float(value) * UNITS[unit or None])
        for row in TABLE
        for place, name, value, unit in BOUND.findall(row)
    ]


def module_of(place: str) -> Any:
    there = [
        package
        for folder, package in PACKAGES.items()
        if (ROOT / folder / package / f"{place}.py").exists() or (ROOT / folder / package / place).is_dir()
    ]
    (package,) = there
    return import_module(f"{package}.{place.replace('/', '.')}")


def test_every_bound_in_the_table_is_that_of_the_code():
    wrong = []
    for place, name, value in bounds():
        found = json.loads(zenoh.Config().get_json(name)) if place == "zenoh" else bound_of(place, name)
        if found != pytest.approx(value):
            wrong.append((place, name, value, found))
    assert wrong == []


def bound_of(place: str, name: str) -> Any:
    found = module_of(place)
    for part in name.split("."):
        found = getattr(found, part)
    return found


def test_every_row_has_a_bound():
    assert len(TABLE) > 15
    assert [row for row in TABLE if not BOUND.search(row)] == []


def test_every_queue_of_the_code_is_in_the_table():
    """Wherever one is made, the module is named in the table."""
    named = {place for row in TABLE for place in PLACE.findall(row)} | {place for place, _, _ in bounds()}
    made = {
        str(path.relative_to(ROOT / folder / package).with_suffix(""))
        for folder, package in PACKAGES.items()
        for path in (ROOT / folder / package).rglob("*.py")
        if any(QUEUE.search(line) for line in path.read_text().splitlines())
    }
    assert {
        "server/zenoh_server",
        "server/answering_thread",
        "bridge/replay_ring",
        "session_follower",
    } <= made
    assert made - named == set()


def test_every_counter_in_the_table_is_a_field():
    counters = re.findall(r"`(\w+Status|JournalReport)\.(\w+)`", "\n".join(TABLE))
    assert len(counters) > 10
    for model, field in counters:
        assert field in getattr(messages, model).model_fields, f"{model}.{field}"
