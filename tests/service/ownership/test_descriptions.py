"""What people state about a session: recorded, kept over restarts, never overwritten unseen."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import Ack, Describe, Description, Open, SessionStatus
from caesura_service.journal import JournalSettings, PeerJournals, SqliteJournal
from caesura_service.ownership.registry import Registry
from caesura_service.publishing.session_state import status_of
from harness.journals import journal_file
from harness.sessions import NAME, STATION, answer, batches, closing, new_registry, opening, published

NOTHING = Description()
WIPE = Description(task="wipe", operator="Ann", tags=("left", "slow"))
RENAMED = WIPE.model_copy(update={"task": "wipe the table"})
OPENED = 1_790_000_000.25  # [s] time of day


@contextmanager
def registry_on(path: Path, peers: PeerJournals | None = None) -> Iterator[Registry]:
    with SqliteJournal(path, JournalSettings()) as journal:
        registry = new_registry(journal, peers=peers)
        assert registry.restore() == []
        yield registry


def describe(
    registry: Registry, before: Description, description: Description, author: str = "Ann"
) -> Ack | ProtocolError:
    command = Describe(session=NAME, author=author, before=before, description=description)
    return answer(registry.handle_command(STATION, command, OPENED + 60.0))


def opened(registry: Registry, description: Description | None = None) -> None:
    begins = opening().model_copy(update={"description": description})
    assert isinstance(answer(registry.handle_command(STATION, begins, OPENED)), Ack)


def closed(registry: Registry, success: bool | None = None) -> None:
    for batch in batches(8):
        registry.handle_samples(STATION, batch, OPENED)
    closes = closing(7).model_copy(update={"success": success})
    assert isinstance(answer(registry.handle_command(STATION, closes, OPENED + 8.0)), Ack)


def status(registry: Registry) -> SessionStatus:
    (state,) = registry.index.all_states()
    return status_of(state)


def test_a_session_has_the_description_of_its_opening_and_the_success_of_its_close(tmp_path):
    with registry_on(tmp_path / "a.sqlite") as registry:
        opened(registry, WIPE)
        assert (status(registry).description, status(registry).opened) == (WIPE, OPENED)
        closed(registry, success=False)
        assert status(registry).description == WIPE.model_copy(update={"success": False})


@pytest.mark.parametrize("is_closed", [False, True])
def test_a_change_is_published_and_kept_over_a_restart(tmp_path, is_closed):
    with registry_on(tmp_path / "a.sqlite") as registry:
        opened(registry, WIPE)
        if is_closed:
            closed(registry, success=True)
        before = status(registry).description
        renamed = before.model_copy(update={"task": "wipe the table"})
        command = Describe(session=NAME, author="Ann", before=before, description=renamed)
        outputs = registry.handle_command(STATION, command, OPENED + 60.0)
        assert [one.description for one in published(outputs, SessionStatus)] == [renamed]
        assert isinstance(describe(registry, before, renamed), Ack), "a repeated command is no error"
        assert status(registry).described == 1, "and no second change"
    with registry_on(tmp_path / "a.sqlite") as registry:
        assert (status(registry).description, status(registry).opened) == (renamed, OPENED)
        assert isinstance(describe(registry, renamed, before), Ack), "which is undo"
        assert status(registry).description == before


@pytest.mark.parametrize("is_closed", [False, True])
def test_each_field_has_the_name_of_who_changed_it_last_also_after_a_restart(tmp_path, is_closed):
    noted = WIPE.model_copy(update={"note": "mind the cable"})
    renamed = noted.model_copy(update={"task": "wipe the table", "tags": ()})
    with registry_on(tmp_path / "a.sqlite") as registry:
        opened(registry, WIPE)
        assert status(registry).described_by == (), "an opening has no author"
        describe(registry, WIPE, noted, author="Bob")
        describe(registry, noted, renamed, author="Ann")
        if is_closed:
            closed(registry)
    with registry_on(tmp_path / "a.sqlite") as registry:
        authors = {one.field: one.author for one in status(registry).described_by}
    assert authors == {"note": "Bob", "task": "Ann", "tags": "Ann"}


def test_a_success_that_a_bridge_states_has_no_author(tmp_path):
    with registry_on(tmp_path / "a.sqlite") as registry:
        opened(registry)
        describe(registry, NOTHING, Description(success=False, task="wipe"))
        closed(registry, success=True)
        assert [one.field for one in status(registry).described_by] == ["task"]


def test_a_description_that_another_operator_changed_is_not_overwritten(tmp_path):
    with registry_on(tmp_path / "a.sqlite") as registry:
        opened(registry)
        assert isinstance(describe(registry, NOTHING, WIPE), Ack)
        refusal = describe(registry, NOTHING, RENAMED)
        assert isinstance(refusal, ProtocolError)
        assert (refusal.code, "another operator" in refusal.message) == ("conflict", True)
        assert status(registry).description == WIPE


def test_a_bridge_that_opens_again_changes_no_description(tmp_path):
    with registry_on(tmp_path / "a.sqlite") as registry:
        opened(registry, WIPE)
        describe(registry, WIPE, RENAMED)
        opened(registry, WIPE)
        opened(registry, None)
        assert status(registry).description == RENAMED


def test_an_outcome_that_lacks_the_last_description_is_not_believed(tmp_path):
    path = tmp_path / "a.sqlite"
    with registry_on(path) as registry:
        opened(registry)
        closed(registry)
    with journal_file(path) as database:
        stale = database.execute("SELECT opening, last_seq, snapshot, crc FROM outcomes").fetchone()
    with registry_on(path) as registry:
        assert isinstance(describe(registry, NOTHING, WIPE), Ack)
    with journal_file(path) as database:  # as when the power goes before the outcome is stored anew
        database.execute("UPDATE outcomes SET opening = ?, last_seq = ?, snapshot = ?, crc = ?", stale)
    with registry_on(path) as registry:
        assert status(registry).description == WIPE


@pytest.mark.parametrize("is_closed", [False, True])
def test_another_instance_takes_the_description_over_and_changes_it(tmp_path, is_closed):
    first, second = tmp_path / "a.sqlite", tmp_path / "b.sqlite"
    with registry_on(first) as a:
        opened(a, WIPE)
        with registry_on(second, peers=PeerJournals(second)) as b:
            assert status(b).description == WIPE
            describe(a, WIPE, RENAMED)
            if is_closed:
                closed(a)
            assert list(b.take_over(STATION, OPENED + 90.0))
            assert status(b).description == RENAMED
            while isinstance(found := describe(b, RENAMED, WIPE), ProtocolError):
                assert found.code == "overloaded", "a session that only the peer has is rebuilt first"
                b.rebuild_step(STATION)
            assert status(b).description == WIPE
    with registry_on(first, peers=PeerJournals(first)) as again:
        assert status(again).description == WIPE


def test_a_journal_of_an_older_version_is_read_and_takes_descriptions(tmp_path):
    path = tmp_path / "a.sqlite"
    with registry_on(path) as registry:
        opened(registry)
        closed(registry)
    with journal_file(path) as database:
        database.executescript("DROP INDEX descriptions_of_session; PRAGMA user_version = 4;")
    other = tmp_path / "b.sqlite"
    with registry_on(other, peers=PeerJournals(other)) as peer:
        assert status(peer).opened == OPENED, "and by a neighbour, which writes nothing to it"
    with registry_on(path) as registry:
        assert status(registry).opened == OPENED
        assert isinstance(describe(registry, NOTHING, WIPE), Ack)
    with registry_on(path) as registry:
        assert status(registry).description == WIPE


def test_an_opening_of_an_older_bridge_has_no_description():
    fields = opening().model_dump()
    del fields["description"]
    assert Open.model_validate(fields).description is None
