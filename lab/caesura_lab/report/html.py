"""Writes a report as one self-contained html file: figures inline, and tables that can be copied.

Figures are drawn once, in the colours of paper. Colours that must change with the reader's light or dark
scheme become variables, and the run-length image, black on nothing, is inverted.
"""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from html import escape
from string import Template

from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from caesura_lab.report.figures import path_page, run_length_page, signals_page, style
from caesura_lab.report.report_data import ReportData
from caesura_lab.report.tables import Table, TableColumn, notes, program_table, segments_table
from caesura_protocol.app_kinds import app_number, app_title
from caesura_protocol.programs.path_drawing import path_svg
from caesura_protocol.reproduced_path import path_in_words

SPARED = 0.55  # [inch] at the top of a page, where its heading was

# Colour on paper → variable of the page's style.
THEMED = {
    style.INK: "ink",
    style.FAINT: "faint",
    style.PAPER: "paper",
    style.RED: "red",
    style.BLUE: "blue",
    style.WINE: "wine",
}


def html_page(content: ReportData) -> str:
    """Return the whole report as html."""
    windows = style.windows(content)
    return _PAGE.substitute(
        title=escape(content.name),
        heading=escape(style.heading(content)),
        swatches="\n".join(f".{kind}{{--kind:{colour}}}" for kind, colour in style.COLOUR_OF_KIND.items()),
        signals="".join(
            _figure(signals_page(content, window), f"signals-{i}") for i, window in enumerate(windows)
        ),
        segments=_table(segments_table(content.view)),
        program=_table(program_table(content.view)),
        ways=_ways(content),
        notes="".join(f"<p>{escape(note)}</p>" for note in notes(content.view, content.notes)),
        path=_figure(path_page(content), "path"),
        run_length="".join(
            _figure(run_length_page(content, window), f"run-length-{i}") for i, window in enumerate(windows)
        ),
    )


def _ways(content: ReportData) -> str:
    """Return the drawn path of each app that has one."""
    drawn = ((index, app, path_svg(app)) for index, app in enumerate(content.view.apps))
    figures = "".join(
        f"<figure>{svg}<figcaption>{app_number(index)} {escape(app_title(app.kind))}, "
        f"{escape(path_in_words(app))}</figcaption></figure>"
        for index, app, svg in drawn
        if svg
    )
    return f'<div class="ways">{figures}</div>' if figures else ""


def _figure(figure: Figure, name: str) -> str:
    """Return a figure for the page, without its heading, which html writes."""
    caption = ""
    for text in figure.texts:
        if text.get_gid() == style.HEADING:
            caption = text.get_text()
            text.set_visible(False)
    figure.set_facecolor("none")
    width, height = style.A4_LANDSCAPE
    file = io.StringIO()
    figure.savefig(
        file,
        format="svg",
        bbox_inches=Bbox([[0.0, 0.0], [width, height - SPARED]]),
        metadata=dict.fromkeys(("Creator", "Date", "Format", "Type")),
    )
    label = escape(f"{figure.get_label()}: {caption}")
    drawing = _inline(file.getvalue(), name, label)
    return f'<figure><div class="wide">{drawing}</div><figcaption>{escape(caption)}</figcaption></figure>'


def _inline(svg: str, name: str, label: str) -> str:
    """Return an svg file as an element of a page: with theme colours, unique ids, and no external address."""
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r'\sxmlns(:\w+)?="[^"]*"', "", svg)
    svg = svg.replace("xlink:href", "href")
    svg = re.sub(r'(\sid="|href="#|url\(#)', rf"\g<1>{name}-", svg)
    for colour, variable in THEMED.items():
        svg = re.sub(colour, f"var(--{variable})", svg, flags=re.IGNORECASE)
    view_box = re.search(r'viewBox="[^"]*"', svg)
    assert view_box is not None, "matplotlib writes a viewBox"
    start = f'<svg role="img" aria-label="{label}" {view_box.group()}>'
    return re.sub(r"<svg[^>]*>", lambda _: start, svg, count=1)


def _table(table: Table) -> str:
    head = "".join(_head(column) for column in table.columns)
    rows = "\n".join(
        _row(table.columns, row, kind) for row, kind in zip(table.rows, table.kinds, strict=True)
    )
    return (
        f'<div class="wide"><table><thead><tr>{head}</tr></thead>\n<tbody>\n{rows}\n</tbody></table></div>'
        f"<p>{escape(table.note)}</p>"
    )


def _head(column: TableColumn) -> str:
    unit = f" <span>[{escape(column.unit)}]</span>" if column.unit else ""
    return f"<th{_flush(column)}>{escape(column.name)}{unit}</th>"


def _row(columns: Sequence[TableColumn], row: Sequence[str], kind: str | None) -> str:
    cells = "".join(
        f"<td{_flush(column)}>{escape(cell)}</td>" for column, cell in zip(columns, row, strict=True)
    )
    return f"<tr>{cells}</tr>" if kind is None else f'<tr class="{kind}">{cells}</tr>'


def _flush(column: TableColumn) -> str:
    return ' class="words"' if column.words else ""


_PAGE = Template("""\
<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>$title · Caesura</title>
<style>
:root{--ink:#1b1d1f;--faint:#6d7278;--paper:#fefefe;--line:#d9dcdf;--red:#d01c1f;--blue:#0072b2;--wine:#882255}
@media (prefers-color-scheme:dark){
:root{--ink:#e8eaec;--faint:#9aa1a8;--paper:#16181b;--line:#34393e;--red:#ff6b62;--blue:#62b6f0;--wine:#ee8cc0}
svg image{filter:invert(1)}
}
*{box-sizing:border-box}
body{margin:0 auto;padding:1.2rem 1rem 3rem;max-width:78rem;background:var(--paper);color:var(--ink);
font:16px/1.5 system-ui,sans-serif}
h1{font-size:1.5rem;line-height:1.2;margin:0;overflow-wrap:anywhere}
h2{font-size:1.15rem;margin:2.2rem 0 .5rem}
p,figcaption{color:var(--faint);font-size:.875rem;margin:.5rem 0;max-width:60rem}
figure{margin:0}
.wide{overflow-x:auto;-webkit-overflow-scrolling:touch}
svg{display:block;width:100%;min-width:46rem;height:auto}
.ways{display:grid;grid-template-columns:repeat(auto-fill,minmax(14rem,1fr));gap:.8rem 1.4rem;margin:1.2rem 0}
svg.way{min-width:0;stroke-width:1.3;color:var(--ink)}
.way text{font-size:10.5px;fill:var(--faint);stroke:none}
.way .frame{stroke:var(--line);stroke-width:1}
.way .via,.way .target{fill:var(--blue)}
.way .tool{stroke:var(--blue);stroke-width:1;opacity:.7}
.way .scale{stroke:var(--faint);fill:none;stroke-width:1}
table{border-collapse:collapse;font-size:.875rem;font-variant-numeric:tabular-nums;white-space:nowrap;width:100%}
th{border-bottom:1.5px solid var(--ink);vertical-align:bottom;white-space:normal}
th span{color:var(--faint);font-weight:400}
td{border-bottom:1px solid var(--line)}
th,td{padding:.3rem .6rem;text-align:right}
.words{text-align:left}
td:first-child{border-left:.5rem solid var(--kind,transparent)}
$swatches
@media print{.wide{overflow:visible}svg{min-width:0}h2{break-after:avoid}figure{break-inside:avoid}}
</style>
</head>
<body>
<h1>$title</h1>
<p>$heading</p>
<h2>Segmentation</h2>
$signals
<h2>Segments</h2>
$segments
<h2>Task program</h2>
$program
$ways
$notes
<h2>Path in space</h2>
$path
<h2>Online against offline</h2>
$run_length
</body>
</html>
""")
