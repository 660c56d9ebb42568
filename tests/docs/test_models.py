"""The example in docs/models.md does what it says, and meets the contract."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy import stats

from caesura_service.changepoint.channel_model import ModelInput, select
from caesura_service.changepoint.channel_model_checks import rows_after
from caesura_service.changepoint.segments import stretches

PAGE = Path(__file__).parents[2] / "docs" / "models.md"


@pytest.fixture(scope="module")
def page() -> dict:
    module = ModuleType("models_page")
    sys.modules[module.__name__] = module  # a model can be stored only where it can be imported from
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert len(blocks) == 4
    assert blocks[0].count("\n") < 50
    for block in blocks:
        exec(block, module.__dict__)
    return module.__dict__


def test_a_model_of_ones_own_finds_its_stretch(page: dict):
    rng = np.random.default_rng(0)
    still = rng.normal(0, 2e-4, (30, 3))
    wandering = still[-1] + np.cumsum(rng.normal(0, 0.01, (30, 3)), axis=0)
    online = page["online"]
    for position in np.vstack([still, wandering]):
        online.step(ModelInput(position, np.zeros(3)))
    found = stretches(online)
    assert [one.verdict.kind.name for one in found] == ["steady", "sliding"]
    assert found[1].start == pytest.approx(30, abs=1)


def test_its_evidence_is_a_density(page: dict):
    assert page["total"] == pytest.approx(1.0, abs=0.01)
    model = page["RandomWalk"](0.1, nu0=1e9)
    walk = np.cumsum(np.random.default_rng(1).normal(0, 0.1, (6, 3)), axis=0)
    rows = rows_after(model, [ModelInput(position, np.zeros(3)) for position in walk])
    steps = np.diff(walk, axis=0, prepend=walk[:1])
    expected = stats.norm.logpdf(steps, 0.0, 0.1).sum()
    assert model.log_evidence(select(rows, np.array([0])))[0] == pytest.approx(expected, abs=1e-4)


@pytest.mark.slow
def test_a_model_set_of_ones_own_is_judged_beside_other_methods(page: dict):
    # The page named a class that there is not, and ended before a recording.
    tables = page["compared"](PAGE.parents[1] / "data" / "wiping.npz")
    rows = [line.split("|")[1].strip() for line in tables.splitlines() if line.startswith("|")]
    assert rows[2:5] == ["default", "mine", "thresholds"]
