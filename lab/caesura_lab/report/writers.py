"""Writes a report as a file: pdf has every page, png the first, html all of it in one self-contained file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import matplotlib as mpl
from matplotlib.backends.backend_pdf import PdfPages

from caesura_lab.report.figures import pages, signals_page, style
from caesura_lab.report.html import html_page
from caesura_lab.report.report_data import ReportData
from caesura_protocol.errors import CaesuraError

Writer = Callable[[ReportData, Path], None]


class UnknownFormatError(CaesuraError):
    """No report can be written under this suffix; the message lists the known ones."""


def writer_of(path: Path) -> Writer:
    """Return the writer for the suffix of a file. Raises UnknownFormatError."""
    writer = WRITERS.get(path.suffix.lower())
    if writer is None:
        raise UnknownFormatError(f"{path}: suffix {path.suffix!r}, expected one of {', '.join(WRITERS)}")
    return writer


def write_report(content: ReportData, path: Path) -> None:
    """Write a report in the format that its suffix names. Raises UnknownFormatError and OSError."""
    writer_of(path)(content, path)


def _write_pdf(content: ReportData, path: Path) -> None:
    metadata = {"Title": style.heading(content), "Creator": "Caesura", "CreationDate": None}
    with mpl.rc_context(style.RC), PdfPages(path, metadata=metadata) as pdf:
        for figure in pages(content):
            pdf.savefig(figure)


def _write_png(content: ReportData, path: Path) -> None:
    with mpl.rc_context(style.RC):
        signals_page(content, style.whole(content)).savefig(path, dpi=style.DPI)


def _write_html(content: ReportData, path: Path) -> None:
    with mpl.rc_context(style.RC):
        page = html_page(content)
    path.write_text(page, encoding="utf-8")


WRITERS: Mapping[str, Writer] = {".pdf": _write_pdf, ".png": _write_png, ".html": _write_html}
