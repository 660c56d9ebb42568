"""Messages at random, built from the models' own annotations."""

from __future__ import annotations

import math
import types
from collections.abc import Callable
from functools import cache
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from hypothesis import strategies as st
from pydantic.fields import FieldInfo

from caesura_protocol.keys import NAME_PATTERN
from caesura_protocol.messages import Message
from caesura_protocol.up_direction import checked_up

NAMES = st.from_regex(NAME_PATTERN.replace("$", r"\Z"))
DIRECTIONS = (
    st.tuples(*[st.floats(-1.0, 1.0)] * 3)
    .filter(lambda vector: math.hypot(*vector) > 0.1)
    .map(lambda vector: checked_up([value / math.hypot(*vector) for value in vector]))
)
SCALARS: dict[Any, st.SearchStrategy[Any]] = {
    bytes: st.binary(max_size=64),
    bool: st.booleans(),
    type(None): st.none(),
    Any: st.none() | st.integers(-(2**63), 2**63) | st.text(max_size=10),
}


@cache
def messages(model: type[Message]) -> st.SearchStrategy[Message]:
    """Instances of a model that it accepts."""
    fields = {name: of(info.rebuild_annotation()) for name, info in model.model_fields.items()}
    return st.builds(model, **fields)


def of(annotation: Any) -> st.SearchStrategy[Any]:
    """Values of an annotation, within its bounds."""
    bounds: dict[str, Any] = {}
    if get_origin(annotation) is Annotated:
        annotation, *metadata = get_args(annotation)
        for item in metadata:
            for bound in item.metadata if isinstance(item, FieldInfo) else [item]:
                bounds |= {key: getattr(bound, key) for key in getattr(bound, "__dataclass_fields__", {})}
                bounds |= {"pattern": bound.pattern} if getattr(bound, "pattern", None) else {}
    return _bounded(annotation, bounds)


def _bounded(annotation: Any, bounds: dict[str, Any]) -> st.SearchStrategy[Any]:
    if bounds.get("func") is checked_up:
        return DIRECTIONS
    origin, arguments = get_origin(annotation), get_args(annotation)
    strategies: dict[Any, Callable[[], st.SearchStrategy[Any]]] = {
        int: lambda: st.integers(bounds.get("ge", 0), bounds.get("le", bounds.get("lt", 2**53) - 1)),
        float: lambda: st.floats(
            bounds.get("ge", bounds.get("gt")),
            bounds.get("le"),
            exclude_min="gt" in bounds,
            allow_nan=False,
            allow_infinity=False,
        ),
        str: lambda: (
            NAMES if "pattern" in bounds else st.text(min_size=bounds.get("min_length", 0), max_size=20)
        ),
        Literal: lambda: st.sampled_from(arguments),
        Union: lambda: st.one_of([of(argument) for argument in arguments]),
        types.UnionType: lambda: st.one_of([of(argument) for argument in arguments]),
        dict: lambda: st.dictionaries(of(arguments[0]), of(arguments[1]), max_size=3),
        tuple: lambda: _tuple(arguments, bounds.get("min_length", 0), bounds.get("max_length") or 4),
    }
    if annotation in SCALARS:
        return SCALARS[annotation]
    return strategies.get(origin or annotation, lambda: messages(annotation))()


def _tuple(arguments: tuple[Any, ...], min_length: int, max_length: int) -> st.SearchStrategy[Any]:
    if arguments[-1] is Ellipsis:
        return st.lists(of(arguments[0]), min_size=min_length, max_size=min(max_length, 4)).map(tuple)
    return st.tuples(*map(of, arguments))
