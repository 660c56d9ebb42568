"""The pages of a report, one module each. All of them draw only the content of a `ReportData`."""

from __future__ import annotations

from collections.abc import Iterator

from matplotlib.figure import Figure

from caesura_lab.report.figures import style
from caesura_lab.report.figures.path import path_page
from caesura_lab.report.figures.run_length import run_length_page
from caesura_lab.report.figures.signals import signals_page
from caesura_lab.report.figures.tables import table_pages
from caesura_lab.report.report_data import ReportData
from caesura_lab.report.tables import program_table, segments_table

__all__ = ["pages", "path_page", "run_length_page", "signals_page"]


def pages(content: ReportData) -> Iterator[Figure]:
    """Yield every page, in the order of reading."""
    windows = style.windows(content)
    yield from (signals_page(content, window) for window in windows)
    yield path_page(content)
    yield from table_pages(content, (segments_table(content.view), program_table(content.view)))
    yield from (run_length_page(content, window) for window in windows)
