"""A wrong value in the words of an error, as people read it in the dashboard."""

import pytest
from pydantic import BaseModel, ValidationError

from caesura_protocol.messages import Author, Name
from caesura_protocol.validation_words import first_finding


class Named(BaseModel):
    author: Author = "Ann"
    station: Name = "cell-1"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        # A Persian name and an emoji were refused with a regular expression over code points.
        (
            {"author": "علی\u200cرضا 👩\u200d👧"},
            "leave out U+200C (zero width non-joiner), U+200D (zero width joiner)",
        ),
        (
            {"author": "Ann\n\u00a0"},
            "expected text on one line without what cannot be seen: leave out U+000A (control character)",
        ),
        ({"author": "x" * 65}, "author has 65 characters, expected at most 64 characters"),
        (
            {"station": "Cell 1"},
            "station is 'Cell 1', expected 1 to 64 of a to z, 0 to 9, - and _, and a letter or a digit first",
        ),
    ],
)
def test_what_cannot_be_seen_is_named(given: dict[str, str], said: str) -> None:
    with pytest.raises(ValidationError) as refused:
        Named.model_validate(given)
    assert first_finding(refused.value).endswith(said)
