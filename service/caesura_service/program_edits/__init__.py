"""Edits of a program: a session's log of them, and the program with them applied."""

from caesura_service.program_edits.edit_log import EditLog, log_of
from caesura_service.program_edits.edited_app_list_cache import EditedAppListCache
from caesura_service.program_edits.program_with_edits import at_edit, check_applies, with_edits

__all__ = [
    "EditLog",
    "EditedAppListCache",
    "at_edit",
    "check_applies",
    "log_of",
    "with_edits",
]
