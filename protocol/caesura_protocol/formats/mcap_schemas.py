"""The messages of an exported file, one model per channel, and their JSON Schemas.

Samples are as they were sent, bit for bit, in the session's units. Content of 3-D panels is in metres in the
base frame, with Foxglove's names. Schemas contain only types that viewers read: objects, arrays of numbers,
strings or objects, and no references, alternatives or nulls; missing values are left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

from pydantic import ConfigDict, Field, field_validator
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from caesura_protocol.messages import (
    App,
    Changepoint,
    Count,
    Gap,
    Joints,
    Message,
    Phase,
    Program,
    Quaternion,
    Seconds,
    Segment,
    Up,
    Vector,
)

BASE, FLANGE = "base", "flange"  # frames


class RobotState(Message):
    """The state reported by the robot; the names of the fields are those of the session's signals."""

    model_config = ConfigDict(title="State")  # the name of the schema in files

    t: Seconds  # [s] session clock
    pos: Vector | None = None  # [length_unit] flange position, base frame
    quat: Quaternion | None = None  # flange orientation, base frame, x y z w
    q: Joints | None = None  # [rad]
    gripper: float | None = None  # [m] opening, or a flag


class Wrench(Message):
    """The measured wrench of the environment on the robot, neither tared nor filtered."""

    t: Seconds  # [s] session clock
    force: Vector | None = None  # [N] in force_frame
    torque: Vector | None = None  # [Nm]
    tau: Joints | None = None  # [Nm] external joint torques


class TaskProgram(Message):
    """The task program at the end, with operators' edits.

    Its apps have no marks of edits, because those have values of several types.
    """

    complete: bool = False  # the session is closed
    apps: tuple[App, ...] = ()
    notes: tuple[str, ...] = ()
    name: str | None = None  # that a person gave it
    edit_revision: Count = 0  # how many edits it has had, each undo and redo too; 0: it is as it was inferred
    force_limit_n: float | None = None  # [N] of the cell: no app exerts more
    robot: str | None = None  # on which it was taught
    up: Up | None = None  # away from gravity, base frame

    @classmethod
    def of(cls, program: Program) -> TaskProgram:
        """Return the content of a file for a program."""
        fields = {name: getattr(program, name) for name in cls.model_fields}
        return cls.model_validate(fields | {"apps": tuple(program.apps)})

    @field_validator("apps")
    @classmethod
    def _without_marks(cls, apps: tuple[App, ...]) -> tuple[App, ...]:
        return tuple(app.model_copy(update={"changes": ()}) if app.changes else app for app in apps)


class Time(Message):
    """A time in Foxglove's form: seconds and nanoseconds."""

    sec: int = Field(ge=0)
    nsec: int = Field(ge=0, lt=10**9)


class Vector3(Message):
    """foxglove.Vector3."""

    x: float
    y: float
    z: float


class Rotation(Message):
    """foxglove.Quaternion."""

    x: float
    y: float
    z: float
    w: float


class Pose(Message):
    """foxglove.Pose."""

    position: Vector3
    orientation: Rotation


class FrameTransform(Message):
    """foxglove.FrameTransform: the pose of the flange."""

    timestamp: Time
    parent_frame_id: str
    child_frame_id: str
    translation: Vector3
    rotation: Rotation


class PosesInFrame(Message):
    """foxglove.PosesInFrame: the whole path."""

    timestamp: Time
    frame_id: str
    poses: tuple[Pose, ...]


#: Topic → name of its schema, and the model of its messages.
CHANNELS: Mapping[str, tuple[str, type[Message]]] = {
    "/state": ("caesura.State", RobotState),
    "/wrench": ("caesura.Wrench", Wrench),
    "/segments": ("caesura.Segment", Segment),
    "/phases": ("caesura.Phase", Phase),
    "/changepoints": ("caesura.Changepoint", Changepoint),
    "/gaps": ("caesura.Gap", Gap),
    "/program": ("caesura.TaskProgram", TaskProgram),
    "/tf": ("foxglove.FrameTransform", FrameTransform),
    "/path": ("foxglove.PosesInFrame", PosesInFrame),
}


@cache
def schema_of(topic: str) -> dict[str, Any]:
    """Return the JSON Schema of a channel's messages."""
    name, model = CHANNELS[topic]
    schema = model.model_json_schema(mode="serialization", schema_generator=_PlainSchema)
    plain: dict[str, Any] = _inlined(schema, schema.pop("$defs", {}))
    return plain | {"title": name}


class _PlainSchema(GenerateJsonSchema):
    """A schema without null: fields that are None are left out.

    Tuples are arrays with items of one type, unions are texts.
    """

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])

    def union_schema(self, schema: core_schema.UnionSchema) -> JsonSchemaValue:
        return {"type": "string"}

    def tuple_schema(self, schema: core_schema.TupleSchema) -> JsonSchemaValue:
        kinds = [self.generate_inner(item) for item in schema["items_schema"]]
        if any(kind != kinds[0] for kind in kinds):
            raise TypeError(f"a tuple of different things is no array that a viewer reads: {kinds}")
        if "variadic_item_index" in schema:
            return {"type": "array", "items": kinds[0]}
        return {"type": "array", "items": kinds[0], "minItems": len(kinds), "maxItems": len(kinds)}

    def field_is_required(
        self,
        field: core_schema.ModelField | core_schema.DataclassField | core_schema.TypedDictField,
        total: bool,
    ) -> bool:
        inner = field["schema"]
        inner = inner["schema"] if inner["type"] == "default" else inner
        return inner["type"] != "nullable" and super().field_is_required(field, total)


def _inlined(schema: Any, definitions: Mapping[str, Any]) -> Any:
    """Return a schema with each reference replaced by its definition."""
    if isinstance(schema, list):
        return [_inlined(item, definitions) for item in schema]
    if not isinstance(schema, dict):
        return schema
    if "$ref" in schema:
        return _inlined(definitions[schema["$ref"].rpartition("/")[2]], definitions)
    return {key: _inlined(value, definitions) for key, value in schema.items()}
