"""Corrections over real Zenoh, with the real service: while a robot is guided, and after that."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from io import StringIO
from itertools import pairwise
from pathlib import Path

import pytest
import typer
from click.testing import Result
from rich.console import Console
from typer.testing import CliRunner

from caesura_clients import Caesura, connect, query, session_corrections
from caesura_clients.bridge import Bridge
from caesura_clients.bridge.sources.file import FileSource
from caesura_clients.bridge.sources.paced_source import FAST
from caesura_clients.cli.commands import register
from caesura_clients.cli.result_tables import program_view
from caesura_clients.cli.stdin_markers import marking
from caesura_clients.correction_words import transport_doubt
from caesura_protocol.errors import CaesuraError, NotFound, ProtocolError
from caesura_protocol.formats.read import load_recording
from caesura_protocol.recording import Recording
from caesura_protocol.session_time_display import clock_from, local_moment
from clients.bridging import QUICK
from clients.conftest import free_port
from clients.examples import LiveSource
from clients.fake_service import eventually
from clients.test_with_service import serving

pytest.importorskip("caesura_service.commands")

TAUGHT = load_recording(Path(__file__).parents[2] / "data" / "pick_and_place.npz")
AT_200_HZ = replace(TAUGHT, t=TAUGHT.t[::5], signals={k: v[::5] for k, v in TAUGHT.signals.items()})
HALF = 6000  # samples


@pytest.fixture(scope="module")
def endpoint() -> Iterator[str]:
    address = f"tcp/127.0.0.1:{free_port()}"
    with serving(address):
        yield address


@pytest.fixture
def caesura(endpoint: str) -> Iterator[Caesura]:
    with connect(endpoint) as connected:
        yield connected


class Guided(LiveSource):
    """A robot that sends the recording as far as it is told to."""

    columns = TAUGHT.columns
    wrench_source = TAUGHT.wrench_source
    force_frame = TAUGHT.force_frame
    length_unit = TAUGHT.length_unit
    samples = TAUGHT.matrix()


def guide(bridge: Bridge, first: int, stop: int) -> None:
    for start, end in pairwise(range(first, stop + 1, 100)):
        bridge.send(Guided.samples[start:end])


def taught(caesura: Caesura, station: str, recording: Recording = AT_200_HZ) -> str:
    with caesura.bridge(station, FileSource(recording, pace=FAST)) as bridge:
        bridge.run()
    return bridge.session


def test_corrections_while_the_demonstration_goes_on_are_what_a_subscriber_receives(
    endpoint: str, caesura: Caesura
):
    last: list = []

    def follow() -> None:
        with connect(endpoint) as watching:
            for update in watching.results("cell-1", silence_s=60.0):
                last[:] = [update]
                if update.closed and update.program.complete and update.status.revision == 5:
                    return

    reader = threading.Thread(target=follow, daemon=True)
    reader.start()
    with Bridge(caesura.transport, "cell-1", Guided(), settings=QUICK) as bridge:
        bridge.wait_open(30.0)
        guide(bridge, 0, HALF)
        eventually(lambda: caesura.snapshot("cell-1").status.samples == HALF)
        edit = {"session": bridge.session, "author": "Ann"}
        assert caesura.insert("cell-1", t=3.02, **edit).revision == 1
        marked = bridge.mark().revision
        guide(bridge, HALF, len(TAUGHT.t))
        assert bridge.finish().revision == marked == 2
        assert caesura.move("cell-1", t=3.0, to=3.52, **edit).revision == 3
        assert caesura.relabel("cell-1", t=5.8, kind="steady", **edit).revision == 4
        assert caesura.undo("cell-1", **edit).revision == 5
        reader.join(60.0)
        snapshot = caesura.snapshot("cell-1")
    corrected = [round(one.t, 2) for one in snapshot.changepoints.changepoints if one.corrected]
    assert corrected == [3.55, pytest.approx(HALF / 1000, abs=0.06)]
    assert not [one for one in snapshot.segments.segments if one.corrected]
    assert (snapshot.status.undoable, snapshot.status.redoable) == (True, True)
    assert (snapshot.program.author, snapshot.program.revision) == ("Ann", 5)
    assert last[0].segments == snapshot.segments.segments
    assert last[0].changepoints == snapshot.changepoints.changepoints
    assert last[0].program == snapshot.program


def test_two_editors_at_once_the_slower_one_is_refused(caesura: Caesura):
    session = taught(caesura, "cell-2")

    def insert(t: float) -> int | ProtocolError:
        try:
            return caesura.insert("cell-2", session, t, author="Ann", revision=0).revision
        except ProtocolError as refusal:
            return refusal

    with ThreadPoolExecutor(2) as editors:
        done = list(editors.map(insert, [2.0, 3.0]))
    (refusal,) = [one for one in done if isinstance(one, ProtocolError)]
    assert session_corrections.is_stale(refusal)
    assert refusal.limit == 1
    corrected = [one.t for one in caesura.snapshot("cell-2").changepoints.changepoints if one.corrected]
    assert len(corrected) == 1


def test_a_marker_does_not_mind_other_editors(caesura: Caesura):
    with Bridge(caesura.transport, "cell-3", Guided(), settings=QUICK) as bridge:
        bridge.wait_open(30.0)
        with pytest.raises(CaesuraError, match="no samples yet"):
            bridge.mark()
        guide(bridge, 0, 3000)
        eventually(lambda: caesura.snapshot("cell-3").status.samples == 3000)
        caesura.insert("cell-3", bridge.session, 2.0, author="Ann")
        caesura.undo("cell-3", bridge.session, author="Ann")
        assert bridge.mark(author="pedal").revision == 3
        guide(bridge, 3000, 5000)
        bridge.finish()
    snapshot = caesura.snapshot("cell-3")
    assert [one.t for one in snapshot.changepoints.changepoints if one.corrected] == [
        pytest.approx(3.0, abs=0.06)
    ]
    assert snapshot.program.author == "pedal"


def count(caesura: Caesura, what: str) -> int | None:
    """Of the station's status; None where the service has no time to tell."""
    try:
        return int(getattr(caesura.snapshot("cell-4").status, what))
    except ProtocolError:
        return None


def test_every_line_on_standard_input_is_a_mark_and_one_that_fails_ends_nothing(caesura: Caesura, capsys):
    with Bridge(caesura.transport, "cell-4", Guided(), settings=QUICK) as bridge:
        bridge.wait_open(30.0)
        with marking(bridge, StringIO("\n")):
            eventually(lambda: "no mark: " in capsys.readouterr().err)
        guide(bridge, 0, 3000)
        eventually(lambda: count(caesura, "samples") == 3000)
        with marking(bridge, StringIO("\n\n")):
            eventually(lambda: count(caesura, "revision") == 2)
        bridge.finish()


def test_a_session_that_is_not_there_is_named(caesura: Caesura):
    with pytest.raises(NotFound, match="nosuch"):
        caesura.undo("cell-9", "nosuch", author="Ann")
    with pytest.raises(ProtocolError, match="unknown_session"):
        caesura.undo("cell-9", "nosuch", author="Ann", revision=0)


# --- the command line -----------------------------------------------------------------------------------


def typed(endpoint: str, *words: str):
    app = typer.Typer()
    register(app)
    return CliRunner().invoke(app, ["edit", *words, "--connect", endpoint])


def test_times_before_the_zero_of_a_clock_are_typed_as_they_are_shown(endpoint: str, caesura: Caesura):
    """A robot whose clock begins below zero: `insert -3` was "No such option: -3"."""
    session = taught(caesura, "cell-13")
    outside = typed(endpoint, "cell-13", session, "insert", "-3.0", "--author", "Ann")
    assert outside.stderr.startswith("error: time -3 s is outside the session (")
    mistyped = typed(endpoint, "cell-13", session, "insert", "3.0", "--auhtor", "Ann")
    assert mistyped.exit_code == 2
    assert "'insert 3.0 --auhtor Ann' is no correction" in " ".join(mistyped.stderr.replace("│", "").split())


def test_the_command_line_corrects(endpoint: str, caesura: Caesura):
    session = taught(caesura, "cell-5")
    done = typed(endpoint, "cell-5", session, "insert", "3.2", "--author", "Bob")
    place = min((one[0] for one in segments_of(caesura, "cell-5")), key=lambda t: abs(t - 3.2))
    said = f"inserted a changepoint at 3.20 s (it is at {place:.2f} s); cell-5/{session} is at revision 1\n"
    assert (done.exit_code, done.stdout.startswith(said)) == (0, True)
    assert caesura.program("cell-5").author == "Bob"
    assert typed(endpoint, "cell-5", session, "undo").exit_code == 0
    stale = typed(endpoint, "cell-5", session, "redo", "--revision", "0")
    assert stale.exit_code == 1
    assert "it is at revision 2, you saw 0" in stale.stderr
    nowhere = typed(endpoint, "cell-5", session, "remove", "3.0")
    assert nowhere.stderr.startswith("error: there is no changepoint near 3 s; the nearest are at ")


def test_the_command_line_warns_of_a_transport_without_a_load_as_the_page_does(
    endpoint: str, caesura: Caesura
):
    session = taught(caesura, "cell-18")
    carried = max(
        (one for one in caesura.snapshot("cell-18").segments.segments if one.load_kg is not None),
        key=lambda one: one.load_kg or 0.0,
    )
    free = caesura.snapshot("cell-18").segments.segments[1]
    words = ("relabel", f"{free.t0 + 0.05}", "transport")
    previewed = typed(endpoint, "cell-18", session, *words, "--preview")
    said = typed(endpoint, "cell-18", session, *words)
    assert previewed.stderr == said.stderr
    empty = caesura.snapshot("cell-18").segments.segments[1]
    assert said.stderr == f"warning: {transport_doubt(empty)}\n"
    assert said.stderr.endswith(" kg: is something carried there?\n")
    sure = typed(endpoint, "cell-18", session, "relabel", f"{carried.t0 + 0.05}", "transport")
    assert (sure.exit_code, sure.stderr) == (0, "")


def test_the_command_line_lists_corrections_and_takes_any_of_them_back(
    endpoint: str, caesura: Caesura, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("COLUMNS", "120")
    session = taught(caesura, "cell-15")
    second = min((one[0] for one in segments_of(caesura, "cell-15")), key=lambda t: abs(t - 4.15))
    assert typed(endpoint, "cell-15", session).stdout == "no corrections\n"
    assert typed(endpoint, "cell-15", session, "insert", "3.0", "--author", "Ann").exit_code == 0
    ((first, _, _),) = [one for one in segments_of(caesura, "cell-15") if abs(one[0] - 3.0) < 0.1]
    assert typed(endpoint, "cell-15", session, "move", "4.15", "4.4", "--author", "Bob").exit_code == 0
    ((moved, _, _),) = [one for one in segments_of(caesura, "cell-15") if abs(one[0] - 4.4) < 0.1]
    assert typed(endpoint, "cell-15", session, "move", "3", "3.4", "--author", "Bob").exit_code == 0
    refused = typed(endpoint, "cell-15", session, "undo", "1")
    assert refused.exit_code == 1
    assert "correction 3 by Bob moved that changepoint on: take correction 3 back first" in refused.stderr

    plain = taught(caesura, "cell-16")
    caesura.insert("cell-16", plain, 3.0, author="Ann")
    caesura.move("cell-16", plain, 3.0, 3.4, author="Bob")
    assert typed(endpoint, "cell-15", session, "undo", "2").exit_code == 0
    assert segments_of(caesura, "cell-15") == segments_of(caesura, "cell-16"), "the others stay"
    listed = typed(endpoint, "cell-15", session).stdout.strip().splitlines()[-3:]
    assert [line.split()[0] for line in listed] == ["1", "2", "3"]
    assert f"Ann inserted a changepoint at {first:.2f} s" in listed[0]
    assert f"Bob moved the changepoint at {second:.2f} s to {moved:.2f} s" in listed[1]
    assert [line.split()[-1] for line in listed] == ["applied", "undone", "applied"]
    assert typed(endpoint, "cell-15", session, "redo").exit_code == 0
    states = [one.state for one in caesura.snapshot("cell-15", session).program.corrections]
    assert states == ["applied"] * 3


def test_the_command_line_states_what_an_edit_did_and_what_one_would_do(endpoint: str, caesura: Caesura):
    session = taught(caesura, "cell-17")
    before = caesura.snapshot("cell-17", session)
    words = ("cell-17", session, "remove", "4.3", "--author", "Ann")
    previewed = typed(endpoint, *words, "--preview")
    assert previewed.exit_code == 0, previewed.stderr
    headline, *effect = previewed.stdout.splitlines()
    assert headline == "nothing is changed; this edit would do:"
    after = caesura.snapshot("cell-17", session)
    published = ("changepoints", "segments", "posterior", "program", "hints")
    assert all(getattr(after, part) == getattr(before, part) for part in published)
    assert (after.status.seq, after.status.revision) == (before.status.seq, before.status.revision)
    removed = min((one.t for one in before.changepoints.changepoints), key=lambda t: abs(t - 4.3))
    done = typed(endpoint, *words)
    assert done.stdout.splitlines() == [
        f"removed the changepoint at 4.30 s (it was at {removed:.2f} s); cell-17/{session} is at revision 1",
        *effect,
    ]
    segments = [one for one in segments_of(caesura, "cell-17") if one[0] < 4.15 < one[1]]
    ((t0, tn, kind),) = segments
    assert f"become {kind} {t0:.2f} to {tn:.2f} s." in effect[0]
    assert f"Ann removed the changepoint at {removed:.2f} s" in typed(endpoint, "cell-17", session).stdout
    made = typed(endpoint, "cell-17", session, "insert", "3.02").stdout
    ((place, _, _),) = [one for one in segments_of(caesura, "cell-17") if abs(one[0] - 3.02) < 0.1]
    assert made.startswith(f"inserted a changepoint at 3.02 s (it is at {place:.2f} s); ")
    headline, *changed = typed(endpoint, "cell-17", session, "since", "0").stdout.splitlines()
    assert headline == "what the corrections have changed:"
    assert changed != effect
    headline, *later = typed(endpoint, "cell-17", session, "since", "1").stdout.splitlines()
    assert headline == "what the corrections after 1 have changed:"
    assert later == made.splitlines()[1:]
    assert caesura.snapshot("cell-17", session).status.revision == 2, "nothing is changed"
    assert typed(endpoint, "cell-17", session, "undo").exit_code == 0
    undone = typed(endpoint, "cell-17", session, "undo")
    assert undone.stdout.startswith(f"took back: Ann removed the changepoint at {removed:.2f} s; ")
    refused = typed(endpoint, "cell-17", session, "remove", "99", "--preview")
    assert refused.exit_code == 1
    assert refused.stderr.startswith("error: time 99 s is outside the session (")


def segments_of(caesura: Caesura, station: str) -> list[tuple[float, float, str]]:
    return [(one.t0, one.tn, one.kind) for one in caesura.snapshot(station).segments.segments]


def test_what_has_no_time_is_not_preceded_by_a_query_where_the_revision_is_stated(
    endpoint: str, caesura: Caesura, monkeypatch: pytest.MonkeyPatch
):
    session = taught(caesura, "cell-14")
    asked: list[tuple[object, ...]] = []
    snapshot = Caesura.snapshot

    def counted(self: Caesura, *named: str | None):
        asked.append(named)
        return snapshot(self, *named)

    monkeypatch.setattr(Caesura, "snapshot", counted)
    for count, words in [(1, ["insert", "3.2", "--revision", "0"]), (0, ["undo", "--revision", "1"])]:
        done = typed(endpoint, "cell-14", session, *words)
        assert done.exit_code == 0, done.stderr
        assert len(asked) == count
        asked.clear()


def test_a_program_is_edited_compared_and_taken_back_from_the_command_line(
    endpoint: str, caesura: Caesura, tmp_path: Path
):
    session = taught(caesura, "cell-9")
    app = typer.Typer()
    register(app)

    def run(*words: str) -> str:
        done = CliRunner().invoke(app, [*words, "--connect", endpoint], env={"COLUMNS": "200"})
        assert done.exit_code == 0, done.output
        return done.output

    def edit(*words: str) -> str:
        return run("edit-program", "cell-9", session, *words, "--author", "Ann")

    inferred = caesura.snapshot("cell-9", session).program
    file = tmp_path / "inferred.json"
    run("program", "--station", "cell-9", "--session", session, "--format", "json", "-o", str(file))
    kinds = [one.kind for one in inferred.apps]
    grasp = str(kinds.index("grasp") + 1)
    assert f"app {grasp} (pick): " in edit("change", grasp, "name=pick", "width=31")
    assert edit("duplicate", "1").endswith("duplicated\n")
    shown = caesura.program("cell-9")
    assert [one.kind for one in shown.apps] == [kinds[0], *kinds]
    assert (shown.apps[int(grasp)].name, shown.apps[int(grasp)].gripper_width) == ("pick", 0.031)
    assert "pick (grasp)" in run("program", "--station", "cell-9")
    edit("change", "2", "speed=0.5")
    assert "speed 50 % of the taught one" in run("program", "--station", "cell-9")
    edit("undo")
    differing = run("program", "--station", "cell-9", "--against", f"cell-9/{session}")
    assert differing == f"no differences from cell-9/{session}\n"
    differing = run("program", "--station", "cell-9", "--against", str(file))
    assert "(move to contact) is added" in differing
    assert "gripper width 31 mm" in differing
    beneath = query.snapshot(caesura.transport, "cell-9", session, inferred=True).program
    assert (beneath.apps, beneath.edit_revision, beneath.edits) == (inferred.apps, 4, ())
    assert "undone: app 1 (move to contact)" in edit("undo")
    assert "undone" in edit()
    edit("delete", grasp)
    laid_out = ("--station", "cell-9", "--session", session, "--inferred", "--format", "json")
    document, without = json.loads(run("program", *laid_out)), json.loads(file.read_text())
    differing_keys = {key for key in without if document[key] != without[key]}
    assert differing_keys <= {"revision", "edits"}, "its times, gaps and units are those of the demonstration"
    edit("undo")
    assert "position name set" in edit("change", "1", "position=above the part")
    assert "above the part" in run("program", "--station", "cell-9", "--session", session)
    assert "position name as taught" in edit("change", "1", "as-taught=position")
    wrong = ["edit-program", "cell-9", session, "change", "1", "width=3", "--connect", endpoint]
    refused = CliRunner().invoke(app, wrong)
    assert refused.exit_code == 1
    assert "'move to contact' moves no fingers" in refused.output


def test_a_part_is_taught_again_from_the_command_line(endpoint: str, caesura: Caesura):
    first, second = taught(caesura, "cell-10"), taught(caesura, "cell-10")
    before = caesura.snapshot("cell-10", first).program.apps
    new = caesura.snapshot("cell-10", second).program.apps
    command = typer.Typer()
    register(command)

    def edit(*words: str) -> Result:
        options = ["--author", "Ann", "--connect", endpoint]
        return CliRunner().invoke(command, ["edit-program", "cell-10", first, *words, *options])

    grasp = next(one for one in before if one.kind == "grasp")
    between = ["--from", str(grasp.t0), "--to", str(grasp.tn)]
    done = edit("replace", *between, "--with", second)
    assert done.exit_code == 0, done.output
    assert f"replaced by session '{second}'" in done.output
    shown = caesura.snapshot("cell-10", first).program.apps
    assert [one.kind for one in shown if one.added] == [one.kind for one in new]
    assert [one for one in shown if one.added is None] == [one for one in before if one != grasp]
    assert edit("undo").exit_code == 0
    assert caesura.snapshot("cell-10", first).program.apps == before
    refused = edit("replace", "1", "1", "--with", first)
    assert refused.exit_code == 1
    assert "replaces no part of itself" in refused.output.replace("\n", " ")


OF_DAY_S = 1_700_000_000.0  # 2023-11-14 22:13:20 UTC


def test_a_session_by_the_time_of_day_is_shown_and_edited_in_seconds_from_its_start(
    endpoint: str, caesura: Caesura, tmp_path: Path
):
    session = taught(caesura, "cell-11", replace(TAUGHT, t=TAUGHT.t + OF_DAY_S))
    before = caesura.snapshot("cell-11", session)
    start = before.segments.segments[0].t0
    assert start > OF_DAY_S
    command = typer.Typer()
    register(command)

    def run(*words: str) -> str:
        done = CliRunner().invoke(command, [*words, "--connect", endpoint], env={"COLUMNS": "200"})
        assert done.exit_code == 0, done.output
        return done.output

    def spans(shown: str) -> list[str]:
        assert shown.count("2023-11-14 22:13:20 UTC") == 1, "the date stands there once"
        assert "17000000" not in shown
        return [f"{one.t0 - start:.2f}–{one.tn - start:.2f}" for one in before.program.apps]

    options = ("--station", "cell-11", "--session", session)
    shown = run("sessions", "show", session, "--station", "cell-11")
    assert f"0.00 {before.segments.segments[0].tn - start:.2f}" in " ".join(shown.split())
    for text in (shown, run("program", *options), run("edit-program", "cell-11", session)):
        assert all(span in text for span in spans(text))
    assert run("watch", "--once", "--station", "cell-11").count("2023-11-14") == 1
    assert local_moment(start) in run("sessions", "list", "--station", "cell-11")

    grasp = next(one for one in before.program.apps if one.kind == "grasp")
    run("edit", "cell-11", session, "insert", f"{grasp.t0 - start + 0.7:.2f}")
    run("edit", "cell-11", session, "insert", f"{start + 0.52:.2f}")  # as a message states it
    corrected = [
        one.t for one in caesura.snapshot("cell-11", session).changepoints.changepoints if one.corrected
    ]
    assert corrected == [pytest.approx(start + 0.52, abs=0.06), pytest.approx(grasp.t0 + 0.7, abs=0.06)]
    run("edit", "cell-11", session, "undo")
    run("edit", "cell-11", session, "undo")

    again = taught(caesura, "cell-11")
    part = ("--from", f"{grasp.t0 - start:.2f}", "--to", f"{grasp.tn - start:.2f}", "--with", again)
    said = run("edit-program", "cell-11", session, "replace", *part)
    assert "(grasp) replaced by session" in said

    shown = Console(width=200, file=StringIO(), record=True)
    noted = before.program.model_copy(update={"notes": (f"Not observed: {start + 0.5:.2f} s.",)})
    shown.print(program_view(noted, clock_from(start)))
    assert "Not observed: 0.50 s." in shown.export_text()

    file = tmp_path / "program.json"
    run("program", *options, "--inferred", "--format", "json", "-o", str(file))
    assert json.loads(file.read_text())["apps"][0]["t0"] > OF_DAY_S, "files keep the session's clock"
