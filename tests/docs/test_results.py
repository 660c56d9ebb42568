"""docs/results.md explains every number that `segment --json` writes, and CITATION.cff names this version."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel
from typer.testing import CliRunner

from caesura_protocol.messages import Changepoint, Gap, Phase, ScrewMotion, Segment, WrenchReport
from caesura_protocol.package_version_and_extras import installed_version
from harness.commands import application

APP = application()
TOP = Path(__file__).resolve().parents[2]
PAGE = (TOP / "docs" / "results.md").read_text(encoding="utf-8")
EXPLAINED = set(re.findall(r"`(\w+)`", PAGE))


@pytest.mark.parametrize("message", [Segment, Changepoint, Phase, Gap, ScrewMotion, WrenchReport])
def test_every_field_of_a_result_is_explained(message: type[BaseModel]):
    assert set(message.model_fields) <= EXPLAINED


def test_the_code_of_the_page_returns_the_json_of_the_command_whose_keys_are_explained(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """`load_recording` of a text ended with an AttributeError."""
    monkeypatch.chdir(TOP)
    (block,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    page: dict[str, Any] = {}
    exec(block, page)
    out = tmp_path / "a.json"
    assert CliRunner().invoke(APP, ["segment", "data/button.npz", "--json", str(out)]).exit_code == 0
    written = json.loads(out.read_text(encoding="utf-8"))
    of_command = {key: written[key] for key in ("origin", "warnings", "notes")}
    assert page["found"] | of_command == written
    assert set(written) <= EXPLAINED


def test_the_citation_names_this_version():
    assert f"version: {installed_version()}\n" in (TOP / "CITATION.cff").read_text(encoding="utf-8")
