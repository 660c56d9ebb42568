"""What is imported before the processes of a test run are forked."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

pytest.importorskip("xdist", reason="pytest-xdist is not installed (extra dev)")

from harness.forked_workers import import_test


@pytest.mark.parametrize(
    ("text", "kept"),
    [
        ("x = 1", True),
        ("import pytest\npytest.skip('not here', allow_module_level=True)", False),
        ("import no_such_module", False),
        ("import warnings\nwarnings.warn('old')", False),
    ],
    ids=["imported", "skips", "fails", "warns"],
)
def test_a_module_that_a_process_would_report_is_left_to_it(tmp_path: Path, text: str, kept: bool) -> None:
    file = tmp_path / "test_one.py"
    file.write_text(text)
    before = set(sys.modules)
    import_test(file, tmp_path)
    found = set(sys.modules) - before
    for name in found:
        del sys.modules[name]
    assert found == ({"test_one"} if kept else set())
