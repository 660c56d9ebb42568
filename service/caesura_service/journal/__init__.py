"""What a session is made of, kept in order: replaying it rebuilds the session bit for bit."""

from caesura_service.journal.journal import (
    Journal,
    JournalBusyError,
    JournalError,
    Key,
    Outcome,
    Record,
    Recordable,
)
from caesura_service.journal.keeping import JournalSettings
from caesura_service.journal.memory import MemoryJournal
from caesura_service.journal.sqlite import SqliteJournal

__all__ = [
    "Journal",
    "JournalBusyError",
    "JournalError",
    "JournalSettings",
    "Key",
    "MemoryJournal",
    "Outcome",
    "Record",
    "Recordable",
    "SqliteJournal",
]
