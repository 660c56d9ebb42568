"""The program that a page shows is that of its session, also while a new one is built in a thread."""

from __future__ import annotations

import asyncio
import threading
from types import SimpleNamespace
from typing import Any

import pytest
from nicegui import core, run

from caesura_clients.dashboard.pages.session import SessionPage
from caesura_clients.dashboard.program_timeline import Timeline
from caesura_clients.dashboard.web_components import ProgramTimeline
from caesura_protocol.messages import Program
from caesura_protocol.session_time_display import NO_OFFSET
from clients.examples import snapshot
from dashboard.conftest import ran

DEADLINE_S = 10.0


class Element(ProgramTimeline):
    """A timeline whose payloads are kept in place of a browser, which has always seen all of them."""

    def __init__(self) -> None:
        self._known: dict[str, Any] = {}
        self.sent: list[dict[str, Any]] = []

    @property
    def is_free(self) -> bool:
        return True

    def send(self, payload: dict[str, Any]) -> None:
        self.sent.append(payload)


def a_page() -> SessionPage:
    page = SessionPage.__new__(SessionPage)
    page.__dict__ |= {
        "_program": Element(),
        "_view": SimpleNamespace(was_seen=True),
        "_clock": NO_OFFSET,
        "_last": None,
        "_timeline": Timeline(),
        "_timeline_of": None,
        "_timeline_how": (NO_OFFSET, None),
        "_is_building": False,
        "_shown": {},
        "_program_desk": None,
        "_simulator": None,
        "_simulation": None,
    }
    return page


async def shown(page: SessionPage, program: Program) -> list[dict[str, Any]]:
    """What a browser receives until the program is built."""
    element: Any = page._program
    element.sent.clear()
    page._show_program(program)
    await asyncio.gather(*asyncio.all_tasks() - {asyncio.current_task()})
    page._show_program(program)
    return [*element.sent]


def test_a_new_session_never_shows_the_program_of_the_one_before(
    monkeypatch: pytest.MonkeyPatch,
):
    first = snapshot(0).program
    second = first.model_copy(update={"session": "s2"})

    async def follow() -> list[list[dict[str, Any]]]:
        monkeypatch.setattr(core, "loop", asyncio.get_running_loop())
        page = a_page()
        received = [await shown(page, first), await shown(page, second)]
        page._program.forget()  # the service holds none meanwhile
        return [*received, await shown(page, first)]

    received = [[one.get("session", "none") for one in part] for part in ran(follow())]
    assert received == [[first.session], ["none", "s2"], [first.session]]


def test_a_program_is_shown_while_many_wait_for_a_service(monkeypatch: pytest.MonkeyPatch):
    program, answered = snapshot(0).program, threading.Event()

    async def follow() -> list[dict[str, Any]]:
        monkeypatch.setattr(core, "loop", asyncio.get_running_loop())
        async with asyncio.timeout(DEADLINE_S):
            return await shown(a_page(), program)

    waiting = [run.thread_pool.submit(answered.wait, 2 * DEADLINE_S) for _ in range(100)]
    try:
        received = ran(follow())
    finally:
        answered.set()
        for one in waiting:
            one.result()
    assert [one["session"] for one in received] == [program.session]
