"""What a session is made of, kept in order: replaying it rebuilds the session bit for bit."""

from caesura_service.journal.journal import Journal, Record, Recordable
from caesura_service.journal.memory import MemoryJournal

__all__ = ["Journal", "MemoryJournal", "Record", "Recordable"]
