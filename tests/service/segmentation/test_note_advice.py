"""Notes, findings and hints are read on pages too, and name no option: only the command line adds it."""

from __future__ import annotations

from itertools import product

import pytest

from caesura_protocol.command_line_advice import ADVICE, at_command_line, on_page
from caesura_protocol.messages import WrenchReport
from caesura_protocol.programs.checks.fidelity import DemonstrationQuality, fidelity_findings
from caesura_protocol.programs.safety import DEFAULT
from caesura_protocol.recording import ASSUMED
from caesura_protocol.wrench_faults import _FORCE
from caesura_service.coaching.measures import Measures
from caesura_service.coaching.rules import RULES, CoachingSetup
from caesura_service.segmentation import input_notes
from caesura_service.signals.wrench_capabilities import (
    HANDS_ON_ROBOT,
    WRENCH_SOURCES,
    wrench_capabilities,
)
from harness.programs import press

WRENCHES = [
    wrench_capabilities(source, hand, stated=stated).note
    for source, hand, stated in product(WRENCH_SOURCES, HANDS_ON_ROBOT, (True, False))
    if not (stated and (source, hand) == ("flange_sensor_with_hand", "no"))
]
SETUP = CoachingSetup(clean_wrench=True, bias_n=2.3, path_tolerance_m=0.001)
(HINT,) = (
    rule.words(Measures(driving_n=9.0), SETUP)[0] for rule in RULES if rule.trigger.kind == "hand_in_wrench"
)
OF_EXPORTS = ("state that of the cell with --cell", "expected --gripper, or Gripper in the dashboard")
TEXTS = (
    *WRENCHES,
    HINT,
    *ASSUMED.values(),
    input_notes.ASSUMED_ROBOT,
    input_notes.UNREAD_JOINTS,
    _FORCE.remedy,
)


def test_what_is_stored_names_no_option():
    assert [text for text in TEXTS if "--" in text] == []


@pytest.mark.parametrize("advice", [one for one in ADVICE if ADVICE[one] not in OF_EXPORTS])
def test_a_command_adds_the_option_to_each_advice_that_there_is(advice: str):
    (text, *_) = [text for text in TEXTS if advice in text]
    assert "--" in at_command_line(text)
    assert on_page(at_command_line(text)) == text, "as in a journal of an older version"


def test_a_finding_on_a_note_has_its_options_only_at_the_command_line():
    wrench = WrenchReport(
        source="flange_sensor_with_hand",
        stated=False,
        hand_on_robot="unknown",
        contact_models=False,
        transport_models=False,
        tare=None,
        note=wrench_capabilities("flange_sensor_with_hand", "unknown", stated=False).note,
    )
    quality = DemonstrationQuality(wrench=wrench, notes=(input_notes.ASSUMED_ROBOT,))
    found = [one for one in fidelity_findings(press(), quality, DEFAULT) if "--" in one.reason]
    assert len(found) == 3
    assert not any("--" in str(one.on_page) for one in found)
