"""The kinds of apps: one row for each, with the facts that check, exporters, simulation and dashboard use.

Text for operators has an app's title, and its number from 1: `app_title`, `app_number`, `app_name`. Messages
and files have its kind, and numbers from 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Literal, NamedTuple, Protocol

AppKind = Literal[
    "cartesian_motion", "move_to_contact", "apply_force", "grasp", "gripper_move", "transport", "hold"
]
Precondition = Literal["reachable", "in_contact", "holding", "not_holding"]


class AppKindFacts(NamedTuple):
    """One kind of app.

    title: text for an operator. needs: fields without which it cannot be run; a kind with one takes time.
    preconditions: conditions that must hold before it. ports: inputs of its action in a behaviour tree.
    drawn_as: kinds of segment in whose colour it is drawn, where it has a path and where it stays. travels:
    whether its flange moves from one place to another. in_contact: whether it keeps the contact of the app
    before it.
    """

    title: str
    needs: tuple[str, ...]
    preconditions: tuple[Precondition, ...]
    ports: tuple[str, ...]
    drawn_as: tuple[str, str]
    travels: bool = False
    in_contact: bool = False

    @property
    def has_target(self) -> bool:
        """Whether an app of this kind has a target."""
        return "target" in self.needs

    @property
    def presses(self) -> bool:
        """Whether an app of this kind exerts a force on the touched object."""
        return "force" in self.needs

    @property
    def carries(self) -> bool:
        """Whether the robot holds an object while the app runs."""
        return "holding" in self.preconditions


_PATH = (
    *("via", "turning", "arrives", "end_velocity", "end_turning"),
    *("length", "tolerance", "tolerance_turn", "max_speed", "max_turn"),
)
_SCREW = ("axis", "axis_point", "angle", "pitch", "torque")
_POSE = ("target", "orientation", "joints", "seconds")
_PLACE = (*_POSE, *_PATH, *_SCREW, "max_force")
_SEARCH = ("contact_force", "contact_speed", "search")
_PRESS = ("force", "force_taught", "waits", "force_before", "force_after", *_PLACE)

APP_KINDS: Mapping[AppKind, AppKindFacts] = MappingProxyType(
    {
        "cartesian_motion": AppKindFacts(
            "move", ("target",), ("reachable",), _PLACE, ("motion", "motion"), travels=True
        ),
        "move_to_contact": AppKindFacts(
            "move to contact",
            ("target",),
            ("reachable",),
            (*_PLACE, *_SEARCH),
            ("motion", "motion"),
            travels=True,
        ),
        "apply_force": AppKindFacts(
            "apply force", ("force",), ("in_contact",), _PRESS, ("sliding", "contact"), in_contact=True
        ),
        "grasp": AppKindFacts(
            "grasp",
            (),
            ("not_holding",),
            ("width", "grip_force", "grip_speed"),
            ("steady", "steady"),
            in_contact=True,
        ),
        "gripper_move": AppKindFacts(
            "move gripper", (), (), ("width", "grip_speed"), ("steady", "steady"), in_contact=True
        ),
        "transport": AppKindFacts(
            "transport",
            ("target",),
            ("reachable", "holding"),
            (*_PLACE, *_SEARCH, "load"),
            ("transport", "transport"),
            travels=True,
        ),
        "hold": AppKindFacts(
            "hold", ("target",), ("reachable", "holding"), (*_PLACE, *_SEARCH, "load"), ("hold", "hold")
        ),
    }
)


def app_number(index: int) -> str:
    """Return the displayed number of an app, a segment or a phase; index: from 0.

    >>> app_number(0)
    '1'
    """
    return str(index + 1)


def facts_of(kind: str) -> AppKindFacts | None:
    """Return the facts of a kind; None for an unknown one."""
    kinds: Mapping[Any, AppKindFacts] = APP_KINDS
    return kinds.get(kind)


def app_title(kind: str) -> str:
    """Return the title of a kind; an unknown kind is returned unchanged."""
    found = facts_of(kind)
    return kind if found is None else found.title


def step_title(kind: str, name: str | None, target_name: str | None) -> str:
    """Return the title of an app and its target, for scripts and behaviour trees.

    >>> step_title("cartesian_motion", None, "above the tray")
    'move: above the tray'
    """
    title = name or app_title(kind)
    return f"{title}: {target_name}" if target_name else title


def app_name(index: int, kind: str, name: str | None = None) -> str:
    """Return the text by which messages refer to an app.

    index: in the program, from 0. name: that a person gave it.

    >>> app_name(1, "apply_force")
    'app 2 (apply force)'
    >>> app_name(1, "apply_force", "press the seal")
    'app 2 (press the seal)'
    """
    return f"app {app_number(index)} ({name or app_title(kind)})"


class NamedApp(Protocol):
    """An app of a message or of a program's file."""

    @property
    def kind(self) -> AppKind:
        """The kind of the app."""

    @property
    def name(self) -> str | None:
        """The name that a person gave it."""


def name_of_app(index: int, app: NamedApp) -> str:
    """Return the text by which messages refer to an app; index: in the program, from 0."""
    return app_name(index, app.kind, app.name)
