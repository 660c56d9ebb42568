"""What the docs and the example files say of security is what the code does."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
import zenoh

from caesura_protocol.messages import MAX_COLUMNS, MAX_MESSAGE_BYTES
from caesura_service.security.zenoh_files import ROUTER_MAX_BYTES
from caesura_service.server.rate_limit_settings import RateLimits
from caesura_service.server.work_queue import QueueSettings
from caesura_service.sessions.limits import Limits

TOP = Path(__file__).resolve().parents[3]
PAGE = (TOP / "docs" / "security.md").read_text()


def test_the_table_of_roles_and_the_example_files_follow_from_the_code():
    check = [sys.executable, str(TOP / "scripts" / "write_security.py"), "--check"]
    done = subprocess.run(check, capture_output=True, text=True, check=False, timeout=120.0)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(
    "file", sorted((TOP / "deploy" / "zenoh").glob("*.json5")), ids=lambda file: file.name
)
def test_the_example_files_are_read_by_zenoh(file):
    assert zenoh.Config.from_file(file).get_json("access_control/enabled") == "true"


def row(what: str) -> str:
    """The limit in a row of the table."""
    (line,) = (line for line in PAGE.splitlines() if line.startswith(f"| {what} |"))
    return line.split("|")[2].strip()


def test_the_limits_on_the_page_are_those_of_the_code():
    rates, queue, limits = RateLimits(), QueueSettings(), Limits()
    for what, rate in (
        ("messages of a station", rates.samples),
        ("commands of a station", rates.commands),
        ("questions about a station", rates.queries),
        ("changes of a station's token", rates.tokens),
    ):
        per_s, burst = (part.split()[0].replace(",", "") for part in row(what).split(", "))
        assert (float(per_s), float(burst)) == rate
    assert (
        row("bytes of a station")
        == f"{rates.bytes.per_s / 1e6:g} MB a second, {rates.bytes.burst / 1e6:g} MB at once"
    )
    assert (MAX_MESSAGE_BYTES, ROUTER_MAX_BYTES) == (1 << 20, 2 << 20)
    assert row("a message") == "1 MiB"
    assert row("samples in a batch, columns") == f"1000, {MAX_COLUMNS}"
    assert row("stations of an instance") == f"{limits.stations}, with sessions at hand"
    assert row("open sessions of a station") == str(limits.open_sessions)
    assert row("closed sessions of a station to be asked for") == str(limits.closed_sessions)
    assert row("the queue of the service, and a station's share of it") == (
        f"{queue.capacity} messages, {queue.capacity_bytes >> 20} MiB; a quarter"
    )
    assert queue.shares == 4
