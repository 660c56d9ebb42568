"""The description of a session in an export: of its opening, with every change, and of its close."""

from __future__ import annotations

from caesura_lab.export.session_export import description_of
from caesura_protocol.messages import Close, Describe, Description, Open
from caesura_service.journal import Record

OPENING = Open(session="s1", columns=("t", "px"))
WIPE = Description(task="wipe", operator="Ann")
RENAMED = WIPE.model_copy(update={"task": "wipe the table"})


def records(*messages: object) -> list[Record]:
    return [Record("cell-1", "s1", float(i), message) for i, message in enumerate(messages)]


def test_a_session_of_an_older_journal_has_none():
    assert description_of(records(OPENING, Close(session="s1", last_seq=-1))) == Description()


def test_changes_count_in_their_order_and_a_bridge_that_opens_again_changes_nothing():
    opening = OPENING.model_copy(update={"description": WIPE})
    change = Describe(session="s1", author="Ann", before=WIPE, description=RENAMED)
    again = opening.model_copy(update={"epoch": 1})
    closing = Close(session="s1", last_seq=-1, success=True)
    assert description_of(records(opening, change, again)) == RENAMED
    succeeded = RENAMED.model_copy(update={"success": True})
    assert description_of(records(opening, change, again, closing)) == succeeded
    doubted = succeeded.model_copy(update={"success": None})
    undone = Describe(session="s1", author="Ann", before=succeeded, description=doubted)
    assert description_of(records(opening, change, closing, undone)) == doubted
