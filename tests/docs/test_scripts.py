"""The Python scripts of docs/api.md and docs/corrections.md run as they stand, against a service."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from dataclasses import replace
from itertools import takewhile
from pathlib import Path

import pytest

from caesura_clients import Caesura, connect
from caesura_clients.bridge.sources.file import FileSource
from caesura_clients.bridge.sources.paced_source import FAST
from caesura_protocol.formats.read import load_recording
from clients.bridging import QUICK
from clients.conftest import free_port
from clients.test_with_service import serving

pytest.importorskip("caesura_service.commands")

ROOT = Path(__file__).parents[2]
TAUGHT = load_recording(ROOT / "data" / "pick_and_place.npz")
AT_200_HZ = replace(TAUGHT, t=TAUGHT.t[::5], signals={k: v[::5] for k, v in TAUGHT.signals.items()})


def script(page: str, first: str) -> str:
    """The indented block of a page that begins with this line."""
    lines = (ROOT / "docs" / page).read_text(encoding="utf-8").splitlines()
    rest = lines[lines.index(f"    {first}") :]
    block = takewhile(lambda line: line.startswith("    ") or not line, rest)
    return textwrap.dedent("\n".join(block))


@pytest.fixture(scope="module")
def caesura() -> Iterator[Caesura]:
    """A service with one session of the station cell-1."""
    address = f"tcp/127.0.0.1:{free_port()}"
    with serving(address), pytest.MonkeyPatch.context() as patch:
        patch.setenv("CAESURA_CONNECT", address)
        with connect() as connected:
            source = FileSource(AT_200_HZ, pace=FAST)
            with connected.bridge("cell-1", source, session="s1", settings=QUICK) as bridge:
                bridge.run()
            yield connected


def test_the_reader_of_the_api_prints_every_change_of_a_session(caesura: Caesura, capsys):
    text = script("api.md", "from caesura_clients import CaesuraError, NotFound, ProtocolError, connect")
    here = text.replace('"tcp/10.0.0.5:7447"', "").replace("silence_s=60.0", "silence_s=1.0")
    assert here.count("connect()") == here.count("silence_s=1.0") == 1
    exec(compile(here, "api.md", "exec"), {})
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.startswith("s1 ")
    assert last.endswith(" True")


def test_the_samples_of_the_api_are_arrays_by_column(caesura: Caesura):
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8").splitlines()
    (line,) = (one for one in page if one.startswith("    caesura.samples("))
    assert set(eval(line.strip(), {"caesura": caesura})) == {"px", "speed"}


def test_the_corrections_of_a_script_are_made_and_taken_back(caesura: Caesura, capsys):
    # Its second undo named the correction that the first one had undone, and was refused.
    text = script("corrections.md", "from caesura_clients import connect")
    exec(compile(text, "corrections.md", "exec"), {"session": "s1"})
    assert capsys.readouterr().out.splitlines()[0].startswith("1 Ann ")
    assert [one.state for one in caesura.program("cell-1").corrections] == ["undone"]
