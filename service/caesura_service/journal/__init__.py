"""The journal: the ordered records of a session, whose replay rebuilds it bit for bit."""

from caesura_service.journal.edits import Edit, Resolution
from caesura_service.journal.journal import (
    Copy,
    Journal,
    JournalBusyError,
    JournalDamagedError,
    JournalError,
    Key,
    Outcome,
    Record,
    Recordable,
)
from caesura_service.journal.keeping import JournalSettings
from caesura_service.journal.memory import MemoryJournal
from caesura_service.journal.reading import (
    BatchSource,
    FileBatches,
    JournalBatches,
    Lost,
    SessionExtent,
    StoredBatch,
)
from caesura_service.journal.siblings import PeerCopy, Siblings
from caesura_service.journal.sqlite import SqliteJournal

__all__ = [
    "BatchSource",
    "Copy",
    "Edit",
    "FileBatches",
    "Journal",
    "JournalBatches",
    "JournalBusyError",
    "JournalDamagedError",
    "JournalError",
    "JournalSettings",
    "Key",
    "Lost",
    "MemoryJournal",
    "Outcome",
    "PeerCopy",
    "Record",
    "Recordable",
    "Resolution",
    "SessionExtent",
    "Siblings",
    "SqliteJournal",
    "StoredBatch",
]
