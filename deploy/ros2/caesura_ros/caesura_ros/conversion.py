"""Caesura's messages as messages of ROS 2, by one rule for each type of field.

ROS 2 has no field that may be absent: a number is NaN then, a text empty, and everything else an array that
is empty. What is one of several types is JSON, as text. `scripts/write_ros_messages.py` writes the
definitions by the same rules.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic_core import to_json

from caesura_protocol.messages import Changepoints, Program, Segments

PACKAGE = "caesura_interfaces"
PUBLISHED: tuple[type[BaseModel], ...] = (Changepoints, Segments, Program)
NUMBERS: Mapping[type, str] = {bool: "bool", int: "int64", float: "float64"}
Make = Callable[[str, dict[str, Any]], Any]  # name of a message, its fields → the message


class Field(NamedTuple):
    """One field of a message; model: that of its elements, where these are messages."""

    name: str
    type: str  # of ROS 2
    model: type[BaseModel] | None
    optional: bool


def fields_of(model: type[BaseModel]) -> Iterator[Field]:
    """The fields of a message, in order. Raises TypeError for a type that has no rule."""
    for name, info in model.model_fields.items():
        kind, optional = _unwrapped(info.annotation)
        element, many = _element(kind)
        nested = element if isinstance(element, type) and issubclass(element, BaseModel) else None
        yield Field(name, _ros_type(f"{model.__name__}.{name}", element, many, optional), nested, optional)


def nested_models(model: type[BaseModel]) -> list[type[BaseModel]]:
    """A message and those in it, each once, those in it first."""
    found: list[type[BaseModel]] = []
    for field in fields_of(model):
        if field.model is not None:
            found += [one for one in nested_models(field.model) if one not in found]
    return [*found, model]


def as_ros(message: BaseModel, make: Make) -> Any:
    """A message as one of ROS 2. make: builds a message from its name and its fields."""
    values = {}
    for field in fields_of(type(message)):
        value = getattr(message, field.name)
        if field.model is not None:
            value = _messages(field, value, make)
        elif value is None:
            value = _absent(field.type)
        elif field.type == "string" and not isinstance(value, str):
            value = to_json(value).decode()
        elif isinstance(value, tuple):
            value = list(value)
        elif field.type.endswith("[<=1]"):
            value = [value]
        values[field.name] = value
    return make(type(message).__name__, values)


def _messages(field: Field, value: Any, make: Make) -> Any:
    if "[" not in field.type:
        return as_ros(value, make)
    many = value if isinstance(value, tuple) else () if value is None else (value,)
    return [as_ros(one, make) for one in many]


def _absent(ros_type: str) -> Any:
    return {"float64": math.nan, "string": ""}.get(ros_type, [])


def _unwrapped(annotation: Any) -> tuple[Any, bool]:
    """A type without its annotations, and whether it may be None."""
    if get_origin(annotation) is Annotated:
        return _unwrapped(get_args(annotation)[0])
    if get_origin(annotation) in {Union, UnionType}:
        kinds = [one for one in get_args(annotation) if one is not NoneType]
        kind = _unwrapped(kinds[0])[0] if len(kinds) == 1 else str
        return kind, NoneType in get_args(annotation)
    return annotation, False


def _element(kind: Any) -> tuple[Any, str]:
    """The type of an array's elements and its size in brackets; a single value's, and nothing."""
    if get_origin(kind) is not tuple:
        return kind, ""
    first, *rest = get_args(kind)
    return _unwrapped(first)[0], "[]" if rest == [Ellipsis] else f"[{1 + len(rest)}]"


def _ros_type(where: str, element: Any, many: str, optional: bool) -> str:
    if element is str or get_origin(element) is Literal:
        name = "string"
    elif isinstance(element, type) and issubclass(element, BaseModel):
        name, many = element.__name__, many or ("[<=1]" if optional else "")
    elif element in NUMBERS:
        name = NUMBERS[element]
    else:
        raise TypeError(f"{where} is {element}, which no rule makes a field of ROS 2")
    if optional and many not in {"", "[]", "[<=1]"}:
        many = many.replace("[", "[<=")
    if optional and not many and name not in {"float64", "string"}:
        many = "[<=1]"
    return f"{name}{many}"
