"""The users of the systemd units: what one of them may read is not open to another."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
UNITS = ROOT / "deploy" / "systemd"
NAMES = sorted(path.name for path in UNITS.glob("*.service"))


def settings(name: str) -> dict[str, str]:
    return dict(re.findall(r"^(\w+)=(.*)$", (UNITS / name).read_text(), re.MULTILINE))


@pytest.mark.parametrize("name", NAMES)
def test_a_unit_has_a_user_that_no_other_unit_has(name):
    def user(unit: str) -> str:
        """Made for the unit where it is dynamic and has no name."""
        found = settings(unit)
        return found.get("User", unit if found.get("DynamicUser") == "yes" else "root")

    others = {user(other) for other in NAMES if other != name}
    assert user(name) not in {"root", *others}


@pytest.mark.parametrize("name", NAMES)
def test_a_user_with_a_name_is_one_that_sysusers_makes(name):
    made = re.findall(r"^u (\S+)", (UNITS / "sysusers.conf").read_text(), re.MULTILINE)
    found = settings(name)
    assert found.get("User") in {*made, None}
    assert found.get("Group") == found.get("User")


@pytest.mark.parametrize("name", NAMES)
def test_files_of_a_unit_are_closed_to_other_users(name):
    found = settings(name)
    assert found["UMask"] == "0077"
    assert found.get("StateDirectoryMode", "0700") == "0700"
    assert ("StateDirectory" in found) == ("StateDirectoryMode" in found)


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd-analyze")
def test_a_unit_that_is_more_exposed_is_found(tmp_path):
    copied = tmp_path / "copy"
    shutil.copytree(UNITS, copied / "deploy" / "systemd")
    shutil.copytree(ROOT / "scripts", copied / "scripts", ignore=shutil.ignore_patterns("__pycache__"))
    command = [str(copied / "scripts" / "lint_units.sh")]
    assert subprocess.run(command, capture_output=True, text=True, check=False).returncode == 0
    unit = copied / "deploy" / "systemd" / "caesura-bridge@.service"
    unit.write_text(unit.read_text().replace("DynamicUser=yes", "User=root"))
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "exposed more than" in done.stderr
