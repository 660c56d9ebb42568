"""What operators state about a session, as texts of a recording's file, by field."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

from pydantic import ValidationError

from caesura_protocol.messages import Description

DESCRIBED = ("task", "operator", "note", "tags", "success")  # fields that a file may state
READ: Mapping[str, Callable[[str], Any]] = {
    "tags": json.loads,
    "success": lambda text: json.loads(text.lower()),  # NumPy writes True
}


def description_texts(description: Description) -> dict[str, str]:
    """Return an operator's statements by field: texts, and other values as JSON.

    What is not stated is left out.

    >>> description_texts(Description(task="wipe", tags=("wet",), success=False))
    {'task': 'wipe', 'tags': '["wet"]', 'success': 'false'}
    """
    stated = description.model_dump(mode="json", exclude_defaults=True, include=set(DESCRIBED))
    return {
        key: value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
        for key, value in stated.items()
    }


def parse_description(stated: Mapping[str, str]) -> tuple[Description, list[str]]:
    """Return the description that a file states, and the keys whose value is none.

    Other software may use these keys for something else, so such a value is no error.
    """
    found, ignored = Description(), []
    for key in DESCRIBED:
        if key not in stated:
            continue
        try:
            value = READ.get(key, str)(stated[key])
            found = Description.model_validate(found.model_dump() | {key: value}, strict=key == "success")
        except (ValidationError, ValueError, RecursionError):
            ignored.append(key)
    return found, ignored
