"""Converts the first finding of a validation to an error text: field, value and limit."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Iterable
from itertools import islice

from pydantic import ValidationError

from caesura_protocol.keys import NAME_PATTERN, NAME_WORDS

Place = tuple[int | str, ...]
MOST_READ = 1000  # characters of a text in which those that cannot be seen are sought; of a name, any number
MOST_NAMED = 5  # of those characters

#: What a validator writes, and how an error states it; in this order.
_PLAIN = (
    (r"Input should be a valid dictionary.*", "expected an object"),
    (r"Input should be a valid (list|tuple|array).*", "expected an array"),
    (r"Input should be ", "expected "),
    (r", unable to (parse|interpret) .*", ""),
    (r"^\w+ should have ", "expected "),
    (r" after validation, not \d+$", ""),
    (rf"^String should match pattern '{re.escape(NAME_PATTERN)}'", f"expected {NAME_WORDS}"),
    (r"^String should match pattern ", "expected text of the pattern "),
    (r"^Value error, ", ""),
    (r"^Invalid JSON: ", "no readable JSON: "),
)


def dotted(place: Place) -> str:
    """Return the name of a nested field: `workspace_low.2`."""
    return ".".join(map(str, place))


def not_one_of(name: str, value: object, known: Iterable[str]) -> str:
    """Return `NAME is VALUE, expected one of …`.

    >>> not_one_of("level", "deep", ("whole", "parts"))
    "level is 'deep', expected one of whole, parts"
    """
    return f"{name} is {value!r}, expected one of {', '.join(known)}"


def first_finding(
    error: ValidationError, known: Iterable[str] = (), named: Callable[[Place], str] = dotted
) -> str:
    """Return `FIELD is VALUE, expected LIMIT`, for the first of the findings.

    known: the existing fields, for an unknown one. named: returns the name of a field from its place.
    """
    one = error.errors(include_url=False)[0]
    place = named(one["loc"])
    if one["type"] == "extra_forbidden":
        return f"unknown field {place}, known: {', '.join(known)}"
    if one["type"] == "missing":
        return f"{place} is missing"
    found = one["msg"]
    for raw, plain in _PLAIN:
        found = re.sub(raw, plain, found)
    if one["loc"] and found.startswith(f"{one['loc'][-1]} is "):  # stated by the validator
        return found
    if one["type"] == "json_invalid":
        return found
    if one["type"] == "string_pattern_mismatch" and (unseen := _unseen(one["input"], one["ctx"]["pattern"])):
        found = f"expected text on one line without what cannot be seen: leave out {unseen}"
    if one["type"] in {"too_long", "string_too_long"}:
        unit = "characters" if one["type"] == "string_too_long" else "items"
        return f"{place or 'the content'} has {len(one['input'])} {unit}, {found}"
    return f"{place or 'the content'} is {one['input']!r:.80}, {found}"


def _unseen(text: str, pattern: str) -> str:
    """Return the first invisible characters of a text that a pattern refuses, by code points and names."""
    text = text[:MOST_READ]
    unseen = [one for one in dict.fromkeys(text) if not one.isprintable()]
    # Each without the others: a joiner is refused by its place, which all that is seen states.
    refused = (one for one in unseen if not re.fullmatch(pattern, _with_alone(text, one)))
    named = list(islice(refused, MOST_NAMED)) or unseen[:MOST_NAMED]
    return ", ".join(
        f"U+{ord(one):04X} ({unicodedata.name(one, 'control character').lower()})" for one in named
    )


def _with_alone(text: str, unseen: str) -> str:
    """Return a text with one of its invisible characters, and without the others."""
    return "".join(one for one in text if one.isprintable() or one == unseen)
