"""Every format is written, is what its suffix says, and holds every segment; errors are one line."""

from __future__ import annotations

import json
import re
import struct
from dataclasses import replace
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import pytest
from typer.testing import CliRunner

from caesura_lab.ground_truth import TrueChangepoint, TrueSegment, Truth
from caesura_lab.report.figures import signals_page
from caesura_lab.report.figures.path import informative_planes
from caesura_lab.report.figures.style import LONGEST_S, windows
from caesura_lab.report.figures.tables import table_pages
from caesura_lab.report.report_data import STEP_S, ReportData, collect
from caesura_lab.report.tables import program_table, segments_table
from caesura_lab.report.writers import UnknownFormatError, write_report
from caesura_protocol.app_kinds import APP_KINDS
from caesura_protocol.recording import Recording
from harness.commands import application
from harness.demonstrations import guided

TRUTH = Truth(
    "taught",
    (0.0, 3.0),
    (TrueChangepoint(0.8, 0.1), TrueChangepoint(2.0, 0.1, optional=True)),
    (TrueSegment(0.0, 0.8, "steady"),),
)
VOID = {"meta", "img", "br"}


@pytest.fixture(scope="module")
def content() -> ReportData:
    return collect(guided(), "default", TRUTH)


@pytest.fixture(scope="module")
def pdf(content: ReportData, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return written(content, tmp_path_factory.mktemp("pdf") / "out.pdf")


@pytest.fixture(scope="module")
def html(content: ReportData, tmp_path_factory: pytest.TempPathFactory) -> str:
    return written(content, tmp_path_factory.mktemp("html") / "out.html").decode()


def written(content: ReportData, path: Path) -> bytes:
    write_report(content, path)
    return path.read_bytes()


def part(recording: Recording, first: int, last: int) -> Recording:
    cut = slice(first, last)
    signals = {name: values[cut] for name, values in recording.signals.items()}
    return replace(recording, t=recording.t[cut], signals=signals)


class ParsedTables(HTMLParser):
    """Rows of cells, and a complaint where a tag is not closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.rows: list[list[str]] = []
        self.ids: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.ids += [value or "" for name, value in attrs if name == "id"]
        if tag not in VOID:
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in {"td", "th"}:
            self.rows[-1].append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "td" in self.open:
            self.rows[-1][-1] += data


@pytest.mark.slow
def test_pdf_has_a_page_for_signals_path_tables_and_run_lengths(pdf: bytes):
    assert pdf.startswith(b"%PDF-")
    assert len(re.findall(rb"/Type /Page\b(?!s)", pdf)) == 4


def test_png_is_page_one_at_150_dots_an_inch(content: ReportData, tmp_path: Path):
    png = written(content, tmp_path / "out.png")
    assert png.startswith(b"\x89PNG\r\n")
    assert struct.unpack(">II", png[16:24]) == (1753, 1240)


def test_html_has_every_segment_and_app_in_a_table(content: ReportData, html: str):
    page = ParsedTables(html)
    assert not page.open
    rows = [row for row in page.rows if row and row[0].isdigit()]
    assert [row[1] for row in rows] == [
        *(one.kind for one in content.view.segments),
        *(APP_KINDS[app.kind].title for app in content.view.apps),
    ]


def test_html_needs_no_other_file_and_names_nothing_twice(html: str):
    assert not re.search(r"https?:|//\w+\.|@import|<script|<link", html)
    ids = ParsedTables(html).ids
    assert len(ids) == len(set(ids))
    assert set(re.findall(r'(?:href="|url\()#([\w.-]+)', html)) <= set(ids)


def unusual(case: str) -> Recording:
    whole = guided()
    match case:
        case "no force":
            return Recording(whole.t, {"pos": whole.signals["pos"]}, wrench_source="none")
        case "gap":
            kept = (whole.t < 2.0) | (whole.t > 2.6)
            return Recording(
                whole.t[kept],
                {name: values[kept] for name, values in whole.signals.items()},
                wrench_source="flange_sensor",
            )
        case "one segment":
            return part(whole, 0, 150)
        case _:
            return part(whole, 0, 38)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "suffix", "divided"),
    [
        ("no force", ".pdf", True),
        ("gap", ".html", True),
        ("one segment", ".html", False),
        ("one observation", ".html", False),
    ],
)
def test_unusual_recordings_are_drawn_all_the_same(case: str, suffix: str, divided: bool, tmp_path: Path):
    content = collect(unusual(case), "default")
    assert (len(content.view.segments) > 1) == divided
    assert len(written(content, tmp_path / f"out{suffix}")) > 10_000


def test_a_table_longer_than_a_page_goes_on_on_the_next(content: ReportData):
    table = segments_table(content.view)
    long = replace(table, rows=table.rows * 12, kinds=table.kinds * 12)
    pages = list(table_pages(content, (long, program_table(content.view))))
    shown = [text.get_text() for page in pages for text in page.texts]
    assert len(pages) > 1
    assert shown.count(table.rows[0][2]) >= 12
    assert "Segments, continued" in shown


def test_notes_go_on_on_the_next_page(content: ReportData):
    """They were written below the edge of the paper, where a table had filled it."""
    said = tuple(f"note {number}" for number in range(60))
    pages = list(table_pages(replace(content, notes=said), (segments_table(content.view),)))
    texts = [text for page in pages for text in page.texts]
    assert set(said) <= {text.get_text() for text in texts}
    assert min(text.get_position()[1] for text in texts) > 0.0


def test_a_long_recording_is_shown_whole_and_then_in_legible_parts(content: ReportData):
    longer = replace(content, signals=replace(content.signals, t=12.0 * content.signals.t))
    whole, *parts = windows(longer)
    assert len(windows(content)) == 1
    assert (parts[0][0], parts[-1][1]) == whole
    assert all(last - first <= LONGEST_S for first, last in parts)
    assert all(before[1] == after[0] for before, after in pairwise(parts))


def test_a_page_draws_what_lies_in_its_window(content: ReportData):
    """Every page drew all segments of the recording: a report of five minutes took as many."""
    first, last = 1.0, 2.5
    seen = [one for one in content.view.segments if one.t0 <= last and one.tn >= first]
    assert 0 < len(seen) < len(content.view.segments)
    page = signals_page(content, (first, last))
    panels = [axes for axes in page.axes if axes.get_ylabel()]
    assert [len(axes.patches) for axes in panels] == [len(seen)] * 4
    for axes in page.axes:
        drawn = [line for one in axes.collections for line in one.get_paths()]
        assert all(first - STEP_S <= x <= last + STEP_S for line in drawn for x, _ in line.vertices)


def test_an_unknown_suffix_names_the_known_ones(content: ReportData, tmp_path: Path):
    with pytest.raises(UnknownFormatError, match=r"'\.docx', expected one of \.pdf, \.png, \.html$"):
        write_report(content, tmp_path / "out.docx")


def test_the_planes_shown_are_those_in_which_something_happens():
    path = guided().signals["pos"] * [1.0, 1.0, 0.0]
    assert informative_planes(path)[0] == (0, 1)


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[tuple[ReportData, Path]]:
    """The content of each report that is written, with its path."""
    written: list[tuple[ReportData, Path]] = []

    def note(content: ReportData, path: Path) -> None:
        written.append((content, path))
        path.touch()

    monkeypatch.setattr("caesura_lab.report.writers.write_report", note)
    return written


def test_the_command_finds_the_truth_beside_the_recording(
    tmp_path: Path, drawn: list[tuple[ReportData, Path]]
):
    guided().save(tmp_path / "taught.npz")
    points = [{"t": 0.8, "tol": 0.1, "level": "major"}]
    spans = [{"t0": 0, "t1": 0.8, "cls": "steady"}]
    annotation = {"window": [0, 3], "changepoints": points, "segments": spans}
    (tmp_path / "taught.ann.json").write_text(json.dumps(annotation))
    out = tmp_path / "out.html"
    result = CliRunner().invoke(application(), ["report", str(tmp_path / "taught.npz"), "-o", str(out)])
    assert result.exit_code == 0, result.output
    ((content, path),) = drawn
    assert content.truth is not None
    assert [point.t for point in content.truth.points] == [0.8]
    assert path == out


def test_an_annotation_of_an_earlier_recording_is_refused_and_can_be_left_out(
    tmp_path: Path, drawn: list[tuple[ReportData, Path]]
):
    """An annotator who had cut the recording anew had to move the annotation away to see a report."""
    guided().save(tmp_path / "taught.npz")
    made_for = {"file": "taught.npz", "sha256": "0" * 64}
    annotation = {"window": [0, 3], "changepoints": [], "recording": made_for}
    (tmp_path / "taught.ann.json").write_text(json.dumps(annotation))
    command = ["report", str(tmp_path / "taught.npz"), "-o", str(tmp_path / "out.html")]
    refused = CliRunner().invoke(application(), command)
    assert refused.exit_code == 1
    assert "--no-truth draws the recording without it" in refused.output
    result = CliRunner().invoke(application(), [*command, "--no-truth"])
    assert result.exit_code == 0, result.output
    assert [content.truth for content, _ in drawn] == [None]


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["taught.npz", "-o", "out.gif"], "suffix '.gif', expected one of .pdf, .png, .html"),
        (["absent.npz", "-o", "out.png"], "no such file"),
        (["taught.npz", "-o", "out.png", "--preset", "best"], "--preset is 'best', expected one of"),
        (["taught.npz", "-o", "nowhere/out.png"], "cannot write nowhere/out.png: no such directory"),
        (["taught.npz", "-o", "out.png", "--truth", "taught.npz"], "taught.npz: not a readable annotation"),
        (["taught.npz", "-o", "out.png", "--truth", "a.json"], "a.json: cannot be read: No such file or dir"),
        (["taught.npz", "-o", "out.png", "--truth", "list.json"], "list.json: is a list, expected an object"),
        # Each was drawn beside results of another recording.
        (["taught.npz", "-o", "out.png", "--truth", "other.json"], "the annotation was made for 0000"),
        (["taught.npz", "-o", "out.png", "--truth", "later.json"], "later.json: window is [100, 200] s, and"),
        (
            ["taught.npz", "-o", "out.png", "--truth", "later.json", "--no-truth"],
            "--no-truth contradicts --truth later.json: state one of them",
        ),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(
    arguments: list[str], complaint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    guided().save(tmp_path / "taught.npz")
    (tmp_path / "list.json").write_text("[1, 2]")
    later = {"window": [100, 200], "changepoints": []}
    (tmp_path / "later.json").write_text(json.dumps(later))
    made_for = {"file": "other.npz", "sha256": "0" * 64}
    (tmp_path / "other.json").write_text(json.dumps({**later, "recording": made_for}))
    result = CliRunner().invoke(application(), ["report", *arguments])
    assert result.exit_code == 1
    assert result.output.startswith("error: ")
    assert complaint in result.output
    assert len(result.output.strip().splitlines()) == 1
