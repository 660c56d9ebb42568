"""A wrong value in the words of an error, as people read it in the dashboard."""

import pytest
from pydantic import BaseModel, ValidationError

from caesura_protocol.messages import Author, Name, as_line
from caesura_protocol.validation_words import first_finding


class Named(BaseModel):
    author: Author = "Ann"
    station: Name = "cell-1"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (  # a joiner counts by its place: only one of these two is in a word that needs it
            {"author": "علی\u200cرضا\u202e"},
            "without what cannot be seen: leave out U+202E (right-to-left override)",
        ),
        ({"author": "pi\u200dck"}, "leave out U+200D (zero width joiner)"),
        ({"author": "علی\u200c"}, "leave out U+200C (zero width non-joiner)"),
        (
            {"author": "علی\u200c\u200dرضا"},
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


# They were refused. The last ones are Malayalam and Sinhala, and a Persian plural of a Latin word.
@pytest.mark.parametrize(
    "name",
    [
        "علی\u200cرضا",
        "👩🏽\u200d🔧 Ann",
        "👨\u200d👩\u200d👧",
        "🏳\ufe0f\u200d🌈",
        "അവന\u0d4d\u200d",
        "ක\u0dca\u200dර",
        "USB\u200cها",
        "کتاب\u200cUSB\u200cها",
        "ක\u0dca\u200d ර",
    ],
)
def test_a_name_may_have_joiners_where_its_script_needs_them(name: str) -> None:
    assert Named(author=name).author == name
    assert as_line(name) == name


@pytest.mark.parametrize(
    "name",
    [
        "pick\u200d",
        "\u200dpick",
        "\u200c",
        "a \u200cb",
        "é\u200d",
        "\u200dعلی",
        "علی\u200c",
        "👩\u200d",
        "USB\u200cه\u200d",
        "اب\u200c\u0d4d\u200c\u200d",
        "علی\u200c رضا",
        "علی\u200c\u00a0رضا",
        "👩\u200d Ann",
        "می\u200c\u3000روم",
    ],
)
def test_a_joiner_that_only_makes_equal_names_differ_is_refused(name: str) -> None:
    with pytest.raises(ValidationError):
        Named(author=name)
    Named(author=as_line(name))


def test_a_text_becomes_a_line_with_a_space_for_each_character_that_is_refused() -> None:
    assert as_line("علی\u200cرضا\u202e\npi\u200dck") == "علی\u200cرضا  pi ck"


def test_of_many_characters_that_cannot_be_seen_the_first_are_named_without_delay() -> None:
    """A station's name of 40 kB took minutes to refuse, and the error was a megabyte long."""
    with pytest.raises(ValidationError) as refused:
        Named.model_validate({"station": "".join(map(chr, range(0xE000, 0xF8FF))) + "a" * 20_000})
    said = first_finding(refused.value)
    assert said.endswith(
        f"leave out {', '.join(f'U+{0xE000 + i:04X} (control character)' for i in range(5))}"
    )
