"""Base of all messages: frozen, compared by value, tolerant of unknown fields."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict

_NOT_ASKED: set[str] = set()


class Message(BaseModel):
    """Base of payloads: frozen, compared by value, tolerant of fields that a newer peer adds."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    @classmethod
    def type_name(cls) -> str:
        """Return the name of the type in messages and in a journal."""
        return cls.__name__

    def model_post_init(self, context: Any, /) -> None:
        """Drop the set of given fields: nothing reads it, and it is half of the memory of a message."""
        object.__setattr__(self, "__pydantic_fields_set__", _NOT_ASKED)
