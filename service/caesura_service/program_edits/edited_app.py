"""An app of a program that is being edited: the inferred or added app, and the values set by edits."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import cached_property
from types import MappingProxyType
from typing import Any

from caesura_protocol.messages import App, AppChange, AppField, AppReference, ChangedField, ProgramEdit
from caesura_protocol.programs.app_time_shifts import is_taught_again
from caesura_service.program_edits.editable_app_fields import FIELDS, SETTERS, SIMPLE_FIELDS

SLACK_S = 0.15  # by which the time of an app is widened at both ends before two are compared

AppKey = tuple[object, ...]


class EditedApp:
    """An inferred or added app, with the values and marks of later edits by field. Immutable."""

    def __init__(
        self,
        inferred: App,
        key: AppKey | None = None,
        values: Mapping[AppField, Any] = MappingProxyType({}),
        marks: tuple[AppChange, ...] = (),
    ) -> None:
        """key: `key_of` the inferred app, if known."""
        self.inferred = inferred
        self.key = key_of(inferred) if key is None else key
        self.values = values
        self.marks = marks

    @cached_property
    def app(self) -> App:
        """The app with its edits; the inferred one itself without any."""
        if not self.marks:
            return self.inferred
        app, simple = self.inferred, dict[str, Any]()
        for name in FIELDS:
            if name in SIMPLE_FIELDS and name in self.values:
                simple[name] = self.values[name]
            elif name in self.values:
                app = app.model_copy(update=SETTERS[name](app, self.values[name]))
        marks = {mark.field: mark for mark in (*app.changes, *self.marks)}
        return app.model_copy(update={**simple, "changes": tuple(marks.values())})

    def marked(self, edit: ProgramEdit, field: ChangedField, inferred: Any = None) -> EditedApp:
        """Return the app with a mark for a field, in place of its earlier mark."""
        mark = AppChange(field=field, author=edit.author, edit=edit.number, inferred=inferred)
        marks = (*(one for one in self.marks if one.field != field), mark)
        return EditedApp(self.inferred, self.key, self.values, marks)

    def without(self, fields: Collection[str]) -> EditedApp:
        """Return the app without the edits of some fields."""
        if not fields:
            return self
        values = {name: value for name, value in self.values.items() if name not in fields}
        marks = tuple(mark for mark in self.marks if mark.field not in fields)
        return EditedApp(self.inferred, self.key, values, marks)

    def with_values(self, given: Mapping[AppField, Any]) -> EditedApp:
        """Return the app with the given values in place of its own."""
        return EditedApp(self.inferred, self.key, {**self.values, **given}, self.marks)


def key_of(app: App) -> AppKey:
    """Return the key that distinguishes an app from the others of a program.

    One edit may add several apps, so the key of an app that was taught again includes its kind and time.
    """
    if app.added is None:
        return (app.kind, app.t0)
    return (app.added, app.kind, app.t0) if is_taught_again(app) else (app.added,)


def keys_meant(wanted: AppReference) -> tuple[AppKey, ...]:
    """Return the keys that the app of a reference may have."""
    if wanted.added is None:
        return ((wanted.kind, wanted.t0),)
    return (wanted.added,), (wanted.added, wanted.kind, wanted.t0)


def common_share(wanted: AppReference, app: App) -> float:
    """Return the share [0, 1] of the joint time of two apps that is common to both."""
    t0, tn = max(wanted.t0, app.t0), min(wanted.tn, app.tn)
    first, last = min(wanted.t0, app.t0), max(wanted.tn, app.tn)
    return max(0.0, tn - t0 + 2 * SLACK_S) / (last - first + 2 * SLACK_S)
