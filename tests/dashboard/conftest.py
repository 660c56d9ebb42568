from __future__ import annotations

from collections.abc import Callable

import pytest

from caesura_clients.results import SessionReader, Update
from caesura_protocol.transport.memory import MemoryNetwork
from clients.examples import snapshot

Make = Callable[..., Update]


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
