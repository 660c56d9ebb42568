"""docs/annotation.md against the code: its example is an annotation, and names all that is needed."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from caesura_lab.ground_truth import KINDS, LEVELS, TruthError, truth_of

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "annotation.md").read_text()
EXAMPLE = json.loads(re.findall(r"```json\n(.*?)```", PAGE, re.DOTALL)[0])


def test_the_example_is_read():
    truth = truth_of(EXAMPLE, "demo")
    assert [point.kind for point in truth.points] == ["start", "contact_on", "contact_off", "optional"]
    assert truth.points[2].accepted_s == (4.1, 4.4)
    assert [span.kind for span in truth.spans] == ["motion", "contact"]
    assert [phase.kind for phase in truth.phases] == ["reach"]
    assert (truth.wrench_source, truth.hand_on_robot) == ("flange_sensor", "yes")
    for name in (*KINDS, *LEVELS):
        assert name in PAGE


@pytest.mark.parametrize("field", ["window", "changepoints"])
def test_what_is_needed_is_named_with_where_an_example_stands(field):
    content = {name: value for name, value in EXAMPLE.items() if name != field}
    with pytest.raises(TruthError, match=rf"'{field}' is missing; docs/annotation.md, The file"):
        truth_of(content, "demo")
    needed = {"window": EXAMPLE["window"], "changepoints": [{"t": 1.0, "tol": 0.1, "level": "major"}]}
    assert truth_of(needed, "demo").spans == ()
