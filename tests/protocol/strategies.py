"""Messages at random, built from the models' own annotations."""

from __future__ import annotations

import types
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from hypothesis import strategies as st
from pydantic.fields import FieldInfo

from caesura_protocol.keys import NAME_PATTERN
from caesura_protocol.messages import Message

NAMES = st.from_regex(NAME_PATTERN.replace("$", r"\Z"))
SCALARS: dict[Any, st.SearchStrategy[Any]] = {
    str: st.text(max_size=20),
    bytes: st.binary(max_size=64),
    bool: st.booleans(),
    type(None): st.none(),
    Any: st.none() | st.integers(-(2**63), 2**63) | st.text(max_size=10),
}


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
    origin, arguments = get_origin(annotation), get_args(annotation)
    if "pattern" in bounds:
        return NAMES
    if annotation is int:
        return st.integers(bounds.get("ge", 0), bounds.get("le", bounds.get("lt", 2**53) - 1))
    if annotation is float:
        return st.floats(bounds.get("ge"), bounds.get("le"), allow_nan=False, allow_infinity=False)
    if origin is Literal:
        return st.sampled_from(arguments)
    if origin in {Union, types.UnionType}:
        return st.one_of([of(argument) for argument in arguments])
    if origin is dict:
        return st.dictionaries(of(arguments[0]), of(arguments[1]), max_size=3)
    if origin is tuple and arguments[-1] is Ellipsis:
        return st.lists(of(arguments[0]), min_size=bounds.get("min_length", 0), max_size=4).map(tuple)
    if origin is tuple:
        return st.tuples(*map(of, arguments))
    return messages(annotation) if annotation not in SCALARS else SCALARS[annotation]
