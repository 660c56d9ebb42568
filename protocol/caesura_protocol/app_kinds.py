"""The kinds of apps: one row for each, with what check, exporters, simulation and dashboard need of it.

For people an app has its title, and its number counts from 1: `app_title`, `app_number`, `app_name`.
On the wire and in files it has its kind, and numbers count from 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, NamedTuple

AppKind = Literal[
    "cartesian_motion", "move_to_contact", "apply_force", "grasp", "gripper_move", "transport", "hold"
]
Precondition = Literal["reachable", "in_contact", "holding", "not_holding"]


class AppKindFacts(NamedTuple):
    """One kind of app.

    title: as an operator reads it. needs: fields without which it cannot be run; what needs one takes time.
    preconditions: what must hold before it. ports: inputs of its action in a behaviour tree.
    travels: its flange goes from one place to another. in_contact: it keeps what the app before it touches.
    """

    title: str
    needs: tuple[str, ...]
    preconditions: tuple[Precondition, ...]
    ports: tuple[str, ...]
    travels: bool = False
    in_contact: bool = False

    @property
    def has_target(self) -> bool:
        """Whether it is run towards a target."""
        return "target" in self.needs

    @property
    def presses(self) -> bool:
        """Whether it exerts a force on what it touches."""
        return "force" in self.needs

    @property
    def carries(self) -> bool:
        """Whether something is held while it runs."""
        return "holding" in self.preconditions


_PATH = ("via", "turning", "arrives", "length", "max_speed", "max_turn")
_SCREW = ("axis", "axis_point", "angle", "pitch", "torque")
_POSE = ("target", "orientation", "joints", "seconds")
_PLACE = (*_POSE, *_PATH, *_SCREW, "max_force")
_PRESS = ("force", "force_taught", "waits", "force_before", "force_after", *_PLACE)

APP_KINDS: Mapping[AppKind, AppKindFacts] = MappingProxyType(
    {
        "cartesian_motion": AppKindFacts("move", ("target",), ("reachable",), _PLACE, travels=True),
        "move_to_contact": AppKindFacts(
            "move to contact", ("target",), ("reachable",), (*_PLACE, "contact_force", "search"), travels=True
        ),
        "apply_force": AppKindFacts("apply force", ("force",), ("in_contact",), _PRESS, in_contact=True),
        "grasp": AppKindFacts("grasp", (), ("not_holding",), ("width",), in_contact=True),
        "gripper_move": AppKindFacts("move gripper", (), (), ("width",), in_contact=True),
        "transport": AppKindFacts(
            "transport", ("target",), ("reachable", "holding"), (*_PLACE, "load"), travels=True
        ),
        "hold": AppKindFacts("hold", ("target",), ("reachable", "holding"), (*_PLACE, "load")),
    }
)


def ends_in_contact(kind: AppKind, following: AppKind | None) -> bool:
    """Return whether a contact ends an app. following: the kind of the next app, None for the last one.

    A carry sets down where the next app is in contact.

    >>> ends_in_contact("transport", "gripper_move"), ends_in_contact("transport", "cartesian_motion")
    (True, False)
    """
    sets_down = APP_KINDS[kind].carries and following is not None and APP_KINDS[following].in_contact
    return kind == "move_to_contact" or sets_down


def app_number(index: int) -> str:
    """The number of an app, a segment or a phase as people read it; index: from 0.

    >>> app_number(0)
    '1'
    """
    return str(index + 1)


def app_title(kind: str) -> str:
    """The title of a kind; a kind that is none stands as it is."""
    found = next((facts for name, facts in APP_KINDS.items() if name == kind), None)
    return kind if found is None else found.title


def step_title(kind: str, name: str | None, target_name: str | None) -> str:
    """Return the title of an app and its target, for scripts and behaviour trees.

    >>> step_title("cartesian_motion", None, "above the tray")
    'move: above the tray'
    """
    title = name or app_title(kind)
    return f"{title}: {target_name}" if target_name else title


def app_name(index: int, kind: str) -> str:
    """An app in a message; index: in the program, from 0.

    >>> app_name(1, "apply_force")
    'app 2 (apply force)'
    """
    return f"app {app_number(index)} ({app_title(kind)})"
