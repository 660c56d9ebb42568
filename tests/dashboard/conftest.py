from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, TypeVar

import pytest

from caesura_clients.session_state_reader import SessionReader, Update
from caesura_protocol.transport.memory import MemoryNetwork
from clients.examples import snapshot

if TYPE_CHECKING:
    from playwright.sync_api import Browser

    from dashboard.browser import Visitor
    from dashboard.stage import Stage

Make = Callable[..., Update]
T = TypeVar("T")


def ran(coroutine: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine in a thread of its own: an open browser has a loop in that of the tests."""
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(asyncio.run, coroutine).result()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark every test that opens a browser as slow."""
    for item in items:
        if "browser" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="package")
def browser() -> Iterator[Browser]:
    """One browser for all tests of this package; each test or module has pages of its own."""
    from dashboard.browser import FOR_SHORT_PAGES, chromium  # noqa: PLC0415 - playwright may not be installed

    with chromium(*FOR_SHORT_PAGES) as browser:
        yield browser


@pytest.fixture(scope="package")
def regular(browser: Browser) -> Iterator[Visitor]:
    """One whose browser has the files of the dashboard in its cache: half of what a page costs."""
    from dashboard.browser import Visitor  # noqa: PLC0415 - playwright may not be installed

    visitor = Visitor(browser)
    yield visitor
    visitor.close()


@pytest.fixture(scope="module")
def opened(regular: Visitor) -> Iterator[Visitor]:
    """A page for the tests of one module, each of which begins again."""
    yield regular
    regular.leave()


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    """A service with a dashboard for the tests of one module."""
    from dashboard.stage import staged  # noqa: PLC0415 - nicegui may not be installed

    with staged(tmp_path_factory.mktemp("stage")) as stage:
        yield stage


@pytest.fixture
def update() -> Make:
    """An update of a session with segments of these kinds; keyword arguments go into every result."""

    def make(*kinds: str, seq: int = 1, **changes: object) -> Update:
        reader = SessionReader()
        reader.restart(snapshot(seq, *kinds, **changes))
        assert reader.update is not None
        return reader.update

    return make


@pytest.fixture
def memory() -> MemoryNetwork:
    return MemoryNetwork()
