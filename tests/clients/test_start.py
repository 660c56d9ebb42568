"""The first second of the command: its version, and Ctrl-C while modules are imported."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest
from typer.testing import CliRunner

from caesura_clients.cli import build
from caesura_protocol.lazy_commands import add_command

PROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]


@pytest.mark.parametrize("option", ["--version", "-V"])
def test_the_version_is_that_of_the_distribution(option):
    shown = CliRunner().invoke(build(()), [option])
    assert (shown.exit_code, shown.stdout) == (0, f"{PROJECT['name']} {version(PROJECT['name'])}\n")


def test_the_list_of_commands_imports_none_of_them():
    """The version once took 1.1 s of CPU, as every command was imported for it."""
    script = (
        "import sys; from contextlib import suppress; from caesura_clients.cli import build\n"
        "with suppress(SystemExit): build()(['--help'])\n"
        "heavy = {'numpy', 'pydantic', 'zenoh', 'msgpack', 'nicegui', 'numba', 'cryptography', 'http'}\n"
        "print(sorted(heavy & {name.partition('.')[0] for name in sys.modules}))\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    *listed, imported = done.stdout.splitlines()
    assert imported == "[]"
    assert any("segment" in line for line in listed)


# As SIGINT does at an import, without its race; and as pydantic turns it into an error of its own.
INTERRUPTED = "raise KeyboardInterrupt\n"
WRAPPED = """import os, signal
try:
    os.kill(os.getpid(), signal.SIGINT)
except KeyboardInterrupt as error:
    raise ValueError("schema") from None
"""


@pytest.mark.parametrize(
    ("interrupted", "content"), [("typer", INTERRUPTED), ("zenoh", INTERRUPTED), ("zenoh", WRAPPED)]
)
def test_ctrl_c_while_modules_are_imported_leaves_no_traceback(tmp_path, interrupted, content):
    (tmp_path / f"{interrupted}.py").write_text(content)
    module, _, function = PROJECT["scripts"]["caesura"].partition(":")
    done = subprocess.run(
        [sys.executable, "-c", f"from {module} import {function}; {function}()", "watch"],
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


def test_a_line_of_the_list_is_read_from_the_docstring_without_an_import(tmp_path, monkeypatch):
    (tmp_path / "unloaded.py").write_text(
        'raise ImportError\ndef run() -> None:\n    """Run it,\n    and return.\n\n    More of it.\n    """\n'
    )
    monkeypatch.syspath_prepend(tmp_path)
    app = build(())
    add_command(app, "run", "unloaded:run")
    assert "Run it, and return." in CliRunner().invoke(app, ["--help"]).stdout


def test_a_library_that_the_system_lacks_is_named_with_its_package(tmp_path):
    """A small image of Debian has no libgomp: `caesura demo` ended with a traceback of 30 lines."""
    stub = tmp_path / "pinocchio.py"
    stub.write_text(
        "raise ImportError('libgomp.so.1: cannot open shared object file: No such file or directory')"
    )
    recording = Path(__file__).parents[2] / "data" / "button.npz"
    found_first = os.pathsep.join((str(tmp_path), os.environ.get("PYTHONPATH", "")))
    done = subprocess.run(
        [sys.executable, "-m", "caesura_clients", "segment", str(recording)],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": found_first},
        check=False,
    )
    said = "error: this machine has no libgomp.so.1; on Debian and Ubuntu install libgomp1\n"
    assert (done.returncode, done.stderr) == (1, said)
