"""The example of the README runs as it stands."""

import re
import textwrap
import tomllib
from pathlib import Path

import pytest

import caesura_clients
from caesura_clients.client import Caesura
from clients.answering import Answering
from clients.examples import segments, snapshot

README = Path(__file__).resolve().parents[2] / "README.md"


def example() -> str:
    """The indented block that begins with the import of `connect`."""
    lines = README.read_text(encoding="utf-8").splitlines()
    first = lines.index("    from caesura_clients import connect")
    block = [line for line in lines[first:] if line.strip()]
    end = next(i for i, line in enumerate(block) if not line.startswith("    "))
    return textwrap.dedent("\n".join(block[:end]))


def installed_by(extra: str) -> set[str]:
    """Extras that an extra of this distribution contains, with itself."""
    extras = tomllib.loads((README.parent / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    named = [one for text in extras[extra] for one in re.findall(r"^caesura-teaching\[(.*)\]", text)]
    return {extra}.union(*(installed_by(one) for names in named for one in names.split(",")))


def test_extras_that_the_two_commands_leave_out_are_named():
    text = " ".join(README.read_text(encoding="utf-8").split())
    known = set(re.findall(r"`(\w+)`", re.findall(r"The extras are (.*?)\.", text)[0]))
    left_out, added = re.findall(r"`make demo` leaves out the (.*?); `make test` adds (.*?)\. ", text)[0]
    named = set(re.findall(r"`(\w+)`", left_out))
    assert named == known - installed_by("demo")
    assert set(re.findall(r"`(\w+)`", added)) == named & installed_by("test")


@pytest.fixture
def teaching(memory, monkeypatch):
    """A session that has begun, and finds its first segments while it is followed."""

    class Ending(Caesura):
        """Ends when there is no more to come."""

        def results(self, station="*", session="*", *, silence_s=None):
            for number, update in enumerate(super().results(station, session, silence_s=0.2)):
                if number == 0:
                    publishing.snapshots = [snapshot(1, "motion", "contact", "transport")]
                    publishing.put(segments(1, 0, "motion", "contact", "transport", first_phase=0))
                yield update

    monkeypatch.setattr(caesura_clients, "connect", lambda: Ending(memory.transport()))
    with Answering(memory.transport()) as publishing:
        publishing.snapshots = [snapshot(0)]
        yield publishing


def test_the_five_lines_survive_a_session_without_segments(teaching, capsys):
    # They once ended with an IndexError: the first update of a new session has no segments.
    assert len(example().splitlines()) == 5
    exec(compile(example(), str(README), "exec"), {})
    first, second = capsys.readouterr().out.splitlines()
    assert first == f"{teaching.snapshots[0].status.t:.1f} s:"
    assert second == f"{first} motion contact transport"
