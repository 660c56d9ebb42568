"""What visitors make the libraries of the dashboard log."""

from __future__ import annotations

import asyncio
import gc
import logging
from collections.abc import Iterator

import pytest

from caesura_clients.dashboard.log_throttle import AT_ONCE, LOGGERS, PER_S, TEXT, BoundedLog, bound_logs
from dashboard.conftest import ran


@pytest.fixture
def bounded() -> Iterator[None]:
    before = {name: list(logging.getLogger(name).filters) for name in LOGGERS}
    bound_logs()
    yield
    for name, filters in before.items():
        logging.getLogger(name).filters = filters


async def _fail() -> None:
    raise KeyError("x" * 100_000)


async def _events(count: int) -> None:
    """As socketio handles events: in tasks whose errors are logged once they are collected."""
    for _ in range(count):
        asyncio.ensure_future(_fail())  # noqa: RUF006
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    gc.collect()


@pytest.mark.usefixtures("bounded")
def test_events_that_no_page_has_made_do_not_fill_the_log(caplog):
    ran(_events(1000))
    assert 0 < len(caplog.records) <= AT_ONCE
    assert len(caplog.text) < 4 * TEXT * AT_ONCE


@pytest.mark.usefixtures("bounded")
def test_a_visitors_text_is_one_line(caplog):
    logging.getLogger("nicegui").error("all is well\n2026-01-01 ERROR all is lost")
    assert caplog.records[-1].getMessage() == r"all is well\n2026-01-01 ERROR all is lost"


def test_what_was_left_out_is_counted_and_comes_back_with_time():
    now = [0.0]
    bounded = BoundedLog(lambda: now[0])

    def logged() -> str | None:
        record = logging.LogRecord("nicegui", logging.ERROR, "", 0, "no", (), None)
        return record.getMessage() if bounded.filter(record) else None

    assert [logged() for _ in range(int(AT_ONCE) + 7)] == ["no"] * int(AT_ONCE) + [None] * 7
    now[0] += 1.0 / PER_S
    assert logged() == "no (7 messages before it were left out)"
    assert logged() is None
