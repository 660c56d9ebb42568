"""Notes of a session on its input: the use of its wrench, and values that its opening does not state."""

from __future__ import annotations

from functools import lru_cache
from typing import cast

from caesura_protocol.messages import Open, WrenchReport, WrenchSource
from caesura_protocol.number_words import fixed
from caesura_protocol.recording import ASSUMED
from caesura_service.changepoint.preset import Preset
from caesura_service.signals import SampleLayout, WrenchCapabilities

# Its weight alone shows a load then, against a bias of free space with a scale of 2.3 N (docs/judge.md).
ASSUMED_ROBOT = (
    "Robot not stated: its seven joints are read as those of a Panda. State the robot if it is another arm."
)
UNREAD_JOINTS = (
    "Robot not stated: no orientation is computed from its joints, and targets have none. State the robot, "
    "or send qx qy qz qw."
)
NO_GRIPPER = (
    "No gripper state: a light load (with preset default below about 0.75 kg) is shown as motion. "
    "Send the column gripper where the robot has one."
)


def standing_notes(
    opening: Open, preset: Preset, layout: SampleLayout, in_use: WrenchCapabilities
) -> tuple[str, ...]:
    """Return the notes that do not change during a session."""
    weighs = any("holding" in kind.channels for kind in preset.kinds) and layout.source.transport_models
    without = weighs and "gripper" not in opening.columns
    of_file = (words for key, words in ASSUMED.items() if key in opening.assumed)
    assumed = opening.robot is None and layout.needs_robot
    return (
        in_use.note,
        *([NO_GRIPPER] if without else []),
        *([ASSUMED_ROBOT] if assumed else []),
        *([UNREAD_JOINTS] if layout.has("q") and not layout.has_orientation else []),
        *of_file,
    )


def frozen_note(since: float) -> str:
    """Return the note on a force that stayed the same number in motion; since: [s] when a hint named it."""
    return (
        f"The force stayed the same number while the robot moved, first until {fixed(since, 1)} s: contacts "
        "and loads were not detected then. Check the sensor and its driver, and teach it again."
    )


def too_fast_note(since: float) -> str:
    """Return the note on a path or a turn that went back between two poses.

    since: [s] when a hint first named it.
    """
    return (
        f"The hand moved too fast for ten poses a second, first at {fixed(since, 1)} s: a part of its path, "
        "such as shaking, is in no app. Teach it again, more slowly where the path turns."
    )


@lru_cache(maxsize=1024)
def wrench_report(
    opening: Open,
    source: str,
    worth: WrenchCapabilities,
    tare: tuple[float, float, float] | None,
    tare_note: str,
) -> WrenchReport:
    """Return the report on how the wrench is used; equal arguments give the same object."""
    return WrenchReport(
        source=cast(WrenchSource, source),
        stated=opening.wrench_source is not None,
        hand_on_robot=opening.hand_on_robot,
        contact_models=worth.contact_models,
        transport_models=worth.transport_models,
        tare=tare,
        note=f"{worth.note} {tare_note}",
        frame=opening.force_frame,
        frame_stated="force_frame" not in opening.assumed,
        up=opening.up,
    )
