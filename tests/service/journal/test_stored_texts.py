"""Names that an older version accepted, and that a new command may not have."""

from __future__ import annotations

from typing import Any

import pytest

from caesura_protocol.codec import encoding_of
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import Describe, Description
from caesura_service.journal import Outcome, Record, SqliteJournal
from caesura_service.journal.stored_texts import decode_stored
from caesura_service.ownership.registry import Registry
from harness.sessions import NAME, STATION, batches, closing, new_registry, opening

OLD_NAME, READ = "علی\u200c", "علی "
OLD_TASK, TASK_READ = "می\u200c روم", "می  روم"


def as_by_an_older_version(message: Any, **fields: Any) -> Any:
    """The same message with fields that are not validated."""
    return type(message).model_construct(**{**message.__dict__, **fields})


def described() -> Describe:
    given = as_by_an_older_version(Description(), task=OLD_TASK, operator=OLD_NAME)
    return as_by_an_older_version(
        Describe(session=NAME, author="Ann", before=Description(), description=Description()),
        author=OLD_NAME,
        description=given,
    )


def restored(journal: SqliteJournal) -> Description:
    registry = new_registry(journal)
    registry.restore()
    (state,) = registry.index.all_states()
    assert state.view.samples > 0
    return state.description


def test_a_session_with_such_names_is_restored(path):
    with SqliteJournal(path) as journal:
        registry = new_registry(journal)
        registry.handle_command(STATION, opening(), 0.0)
        for each in batches(30):
            registry.handle_samples(STATION, each, 0.0)
        journal.append(Record(STATION, NAME, 1.0, described()))
        found = restored(journal)
        assert (found.task, found.operator) == (TASK_READ, READ)


def test_so_is_one_that_has_ended(path):
    with SqliteJournal(path) as journal:
        registry: Registry = new_registry(journal)
        registry.handle_command(STATION, opening(), 0.0)
        sent = batches(30)
        for each in sent:
            registry.handle_samples(STATION, each, 0.0)
        registry.handle_command(STATION, closing(len(sent) - 1), 0.0)
        outcome = journal.outcome(STATION, NAME)
        assert outcome is not None
        status = as_by_an_older_version(outcome.snapshot.status, description=described().description)
        snapshot = as_by_an_older_version(outcome.snapshot, status=status)
        journal.store_outcome(STATION, Outcome(outcome.opening, outcome.last_seq, snapshot))
    with SqliteJournal(path) as journal:
        found = restored(journal)
        assert (found.task, found.operator) == (TASK_READ, READ)


def test_what_is_damaged_otherwise_is_refused_as_before():
    with pytest.raises(ProtocolError, match="session"):
        decode_stored(b"\x80", encoding_of(Describe), Describe)
    with pytest.raises(ProtocolError, match="not msgpack"):
        decode_stored(b"\xc1", encoding_of(Describe), Describe)
