"""Advice in notes, hints, findings and refusals, as a page and as the command line gives it.

Notes and hints are stored and sent, and read on a page as well as in a terminal. So they name no option. A
command exchanges their advice for one that does. What only a command wrote before has its options; a page
exchanges them.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

ADVICE: Mapping[str, str] = MappingProxyType(
    {
        "State the wrench source.": "State it with --wrench-source.",
        "state the wrench source flange_sensor_with_hand.": (
            "start the bridge with --wrench-source flange_sensor_with_hand."
        ),
        "If there is none, state that.": "State --hand-on-robot no where there is none.",
        "State the robot if it is another arm.": "State --robot if it is another arm.",
        "State the robot, or send qx qy qz qw.": "State --robot, or send qx qy qz qw.",
        "State whether it is base or flange; flange needs an orientation.": (
            "State force_frame in the file, or --force-frame: base, or flange, which needs an orientation."
        ),
        "state its unit if the values are right": "state --force-unit N if the values are right",
        "write the script with the workspace of that cell": "state that of the cell with --cell",
        "expected Gripper beside Export": "expected --gripper, or Gripper in the dashboard",
    }
)
_ADVICE_OF_OPTIONS: Mapping[str, str] = MappingProxyType(
    {options: advice for advice, options in ADVICE.items()}
)


def at_command_line(text: str) -> str:
    """Return a text with the options of its advice.

    >>> at_command_line("Robot not stated: no poses. State the robot, or send qx qy qz qw.")
    'Robot not stated: no poses. State --robot, or send qx qy qz qw.'
    """
    return _exchanged(text, ADVICE)


def on_page(text: str) -> str:
    """Return a text without the options of its advice.

    >>> on_page("Robot not stated: no poses. State --robot, or send qx qy qz qw.")
    'Robot not stated: no poses. State the robot, or send qx qy qz qw.'
    """
    return _exchanged(text, _ADVICE_OF_OPTIONS)


def _exchanged(text: str, by: Mapping[str, str]) -> str:
    for old, new in by.items():
        text = text.replace(old, new)
    return text
