"""Two sets of results are compared value by value."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

TOP = Path(__file__).resolve().parents[2]


def test_each_value_that_differs_is_named_by_its_place(script, capsys):
    compare = script("compare_results").compare
    before = {"a.npz default": {"segments": [{"t0": 0.0, "kind": "motion"}], "notes": []}}
    after = {"a.npz default": {"segments": [{"t0": 0.1, "kind": "motion"}, {"t0": 2.0}], "notes": []}}
    assert compare(before, before) == 0
    assert compare(before, after) == 1
    printed = capsys.readouterr().out
    assert "a.npz default: 2 values differ\n  segments[0].t0: 0.0 → 0.1\n" in printed
    assert printed.endswith("1 of 1 results differ\n")


def test_the_results_of_this_checkout_equal_themselves_and_no_others(script, tmp_path, monkeypatch, capsys):
    module = script("compare_results")
    monkeypatch.setattr(module, "recordings", lambda: [TOP / "data" / "button.npz"])
    file = tmp_path / "before.json"
    assert module.main(["--write", str(file), "--presets", "default"]) == 0
    assert module.main(["--against", str(file)]) == 0
    before = json.loads(file.read_text())
    before["button.npz default"]["segments"][0]["tn"] += 1e-9
    file.write_text(json.dumps(before))
    assert module.main(["--against", str(file)]) == 1
    assert "button.npz default: 1 values differ" in capsys.readouterr().out


def test_misuse_is_refused(script):
    with pytest.raises(SystemExit):
        script("compare_results").main([])
