"""Times in sentences are read as those in tables are."""

from __future__ import annotations

import pytest

from caesura_protocol.session_time_display import NO_OFFSET, SessionClock

CLOCK = SessionClock(1_700_000_001.25)


@pytest.mark.parametrize(
    ("note", "shown"),
    [
        ("Not observed: 1700000003.00–1700000003.75 s (lost).", "Not observed: 1.75–2.50 s (lost)."),
        ("The session ended before 1700000002.25.", "The session ended before 1.00."),
        ("2.50 s of bag-1700000002.50 and of 1700000002 are 1700000002.50.1", None),
    ],
)
def test_times_of_day_in_a_note_are_read_from_the_start(note: str, shown: str | None) -> None:
    """They stood below tables that count from the start."""
    assert CLOCK.text(note) == (note if shown is None else shown)
    assert NO_OFFSET.text(note) == note
