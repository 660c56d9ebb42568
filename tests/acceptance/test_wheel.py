"""The built wheel, installed apart from the checkout."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest

from caesura_protocol.package_version_and_extras import DISTRIBUTION, installed_version

ROOT = Path(__file__).parents[2]
HEAVY = {"scipy", "pinocchio", "numba"}
# In the index the name is another project's.
STRANGER = re.compile(r"pip install '?caesura(\[|\s|`|$)", re.MULTILINE)

LOOK = """
import importlib, json, pkgutil, sys
import caesura_clients, caesura_protocol
for package in (caesura_clients, caesura_protocol):
    for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        if not {"teacher", "rerun_sink"} & {*module.name.split(".")}:  # the latter needs the extra rerun
            importlib.import_module(module.name)
modules = sorted({name.partition(".")[0] for name in sys.modules})
print(json.dumps({"where": caesura_clients.__file__, "modules": modules}))
"""


def run(*command: object, **options: object) -> str:
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False, **options)  # type: ignore[call-overload]
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    built, place = tmp_path_factory.mktemp("wheel"), tmp_path_factory.mktemp("site")
    run(sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", built, cwd=ROOT)
    (wheel,) = built.glob("*.whl")
    with ZipFile(wheel) as packed:  # as pip installs what has no compiled part
        packed.extractall(place)
    return place


def test_it_contains_every_package_with_its_data(installed: Path):
    sources = [
        path.relative_to(ROOT / folder)
        for folder in ("protocol", "service", "clients")
        for path in (ROOT / folder).rglob("*")
        if path.suffix in {".py", ".urdf", ".json", ".typed"}
    ]
    assert len(sources) > 100
    assert [str(path) for path in sources if not (installed / path).exists()] == []


def test_a_client_imports_nothing_heavy(installed: Path, tmp_path: Path):
    reported = run(sys.executable, "-c", LOOK, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(installed)})
    found = json.loads(reported)
    assert Path(found["where"]).is_relative_to(installed)
    assert HEAVY & set(found["modules"]) == set()


def test_no_hint_names_a_distribution_that_is_another_projects(installed: Path):
    (metadata,) = installed.glob("*.dist-info/METADATA")
    lines = metadata.read_text().splitlines()
    assert {f"Name: {DISTRIBUTION}", f"Version: {installed_version()}"} <= set(lines)
    sources = [*ROOT.glob("README.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("deploy/**/*.*")]
    for folder in ("protocol", "service", "clients"):
        sources += (ROOT / folder).rglob("*.py")
    strangers = [str(file) for file in sources if STRANGER.search(file.read_text(errors="replace"))]
    assert strangers == []


def test_an_install_without_extras_asks_for_nothing_heavy(installed: Path):
    (metadata,) = installed.glob("caesura_teaching-*.dist-info/METADATA")
    wanted = [line for line in metadata.read_text().splitlines() if line.startswith("Requires-Dist:")]
    plain = [line for line in wanted if "extra ==" not in line]
    assert plain
    assert not [
        line for line in plain for name in ("scipy", "numba", "pin") if line.split()[1].startswith(name)
    ]
    assert [line for line in wanted if "scipy" in line]
