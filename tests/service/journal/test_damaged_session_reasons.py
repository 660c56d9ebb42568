"""The reason of a damaged session as the text of a status."""

from pydantic import TypeAdapter

from caesura_protocol.messages import MAX_STATUS_TEXT
from caesura_protocol.messages.field_types import StatusText
from caesura_service.journal.damaged_sessions import _printable


def test_a_reason_that_is_cut_within_a_word_with_a_joiner_is_a_text_still() -> None:
    """The report on the journal was refused: the joiner stood without the character after it."""
    why = _printable("x" * (MAX_STATUS_TEXT - 2) + "a\u200cب")
    assert TypeAdapter(StatusText).validate_python(why) == "x" * (MAX_STATUS_TEXT - 2) + "a "
