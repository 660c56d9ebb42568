"""The journal: the ordered records of a session, whose replay rebuilds it bit for bit."""

from caesura_service.journal.applied_edits import AppliedEdit, AppliedProgramEdit, Resolution
from caesura_service.journal.batch_reader import (
    BatchRow,
    BatchSource,
    FileBatches,
    JournalBatches,
    Lost,
    SessionExtent,
)
from caesura_service.journal.copy_conflicts import Changes, last_owned, refused_in
from caesura_service.journal.journal import (
    Copy,
    EncodedBatch,
    Journal,
    JournalBusyError,
    JournalDamagedError,
    JournalError,
    JournalMalformedError,
    JournalShareError,
    JournalSupersededError,
    JournalUnreadableError,
    Key,
    Outcome,
    PeerJournalError,
    Record,
    Recordable,
    Refused,
    StoredOutcome,
)
from caesura_service.journal.memory_journal import MemoryJournal
from caesura_service.journal.peer_journals import PeerCopy, PeerJournals
from caesura_service.journal.retention import JournalSettings
from caesura_service.journal.sqlite_journal import SqliteJournal

__all__ = [
    "AppliedEdit",
    "AppliedProgramEdit",
    "BatchRow",
    "BatchSource",
    "Changes",
    "Copy",
    "EncodedBatch",
    "FileBatches",
    "Journal",
    "JournalBatches",
    "JournalBusyError",
    "JournalDamagedError",
    "JournalError",
    "JournalMalformedError",
    "JournalSettings",
    "JournalShareError",
    "JournalSupersededError",
    "JournalUnreadableError",
    "Key",
    "Lost",
    "MemoryJournal",
    "Outcome",
    "PeerCopy",
    "PeerJournalError",
    "PeerJournals",
    "Record",
    "Recordable",
    "Refused",
    "Resolution",
    "SessionExtent",
    "SqliteJournal",
    "StoredOutcome",
    "last_owned",
    "refused_in",
]
