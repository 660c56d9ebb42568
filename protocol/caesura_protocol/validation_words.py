"""The first finding of a validation in the words of an error: field, value and limit."""

from __future__ import annotations

from collections.abc import Iterable

from pydantic import ValidationError

_MEANT = {"Input should be ": "expected ", "Invalid JSON: ": "no readable JSON: "}


def first_finding(error: ValidationError, known: Iterable[str] = ()) -> str:
    """Return `FIELD is VALUE, expected LIMIT`, for the first of the findings.

    known: the fields that there are, for an unknown one.
    """
    one = error.errors(include_url=False)[0]
    place = ".".join(str(part) for part in one["loc"])
    if one["type"] == "extra_forbidden":
        return f"unknown field {place}, known: {', '.join(known)}"
    if one["type"] == "missing":
        return f"{place} is missing"
    said = one["msg"]
    for raw, plain in _MEANT.items():
        said = said.replace(raw, plain)
    if one["type"] == "json_invalid":
        return said
    return f"{place or 'the content'} is {one['input']!r:.80}, {said}"
