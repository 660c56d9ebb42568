"""When a browser shows a session of an hour, opened after a restart of everything, and how long a zoom takes.

A session is taught, as fast as the service takes it. Service and dashboard end and begin anew. Then pages of
browsers without a cache open the session. Printed is the time from the beginning of the navigation until the
plots have drawn the samples that are in sight, until the segments are drawn with them, and until the program
stands beside them. A zoom takes from the press of
the button until the plots have drawn samples of the new range. Seven of them lead from the whole session to a
128th of it. The first page comes to a dashboard and a service that have served nothing yet.
Usage: python tests/bench/recorded_page.py [--seconds 3600] [--pages 5] [--folder DIR]
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
from playwright.sync_api import Browser

sys.path.insert(0, str(Path(__file__).parents[1]))

from dashboard.browser import DESK, SETTLED, Visitor, chromium
from dashboard.stage import Stage, staged
from harness.demonstrations import taught
from harness.processes import eventually

WANTED_FIRST_S, WANTED_ZOOM_S = 1.0, 0.2
STATION, SESSION = "cell-1", "s1"
ZOOMS = 7
MOST_S = 1200.0  # that the teaching may take
# [ms] since the beginning of the navigation, of the frame in which the plots have drawn what is in sight.
DRAWN_AT = f"() => ({SETTLED})(document.querySelector('.plots') || {{}}) && performance.now()"
SEGMENTS_AT = DRAWN_AT.replace(
    "() => ", "() => document.querySelector('.plots')?.plots?.state.segments.length > 1 && "
)
PROGRAM_AT = "() => document.querySelector('.app') && performance.now()"
# [ms] from a press on `Zoom in` until the plots have drawn the new range.
ZOOM = f"""() => new Promise((resolve) => {{
  const plots = document.querySelector(".plots"), before = plots.dataset.from, began = performance.now();
  const look = () => plots.dataset.from !== before && ({SETTLED})(plots)
    ? resolve(performance.now() - began) : requestAnimationFrame(look);
  document.querySelector("[aria-label='Zoom in']").click();
  requestAnimationFrame(look);
}})"""


def teach(folder: Path, seconds: float) -> None:
    """A session in the journal, which has ended."""
    with staged(folder) as stage, stage.reader() as reader:
        stage.teach(STATION, taught(7, seconds), session=SESSION, pace="fast")
        eventually(lambda: bool(reader.sessions(STATION)))
        eventually(lambda: reader.sessions(STATION)[0].state == "closed", MOST_S)
        print(f"session of {seconds:g} s, {len(reader.program(STATION).apps)} apps", flush=True)


def looked_at(stage: Stage, browser: Browser) -> tuple[float, float, float, list[float]]:
    """[s] until the first picture, until segments are drawn, until the program, and of each zoom."""
    visitor = Visitor(browser, viewport=DESK)
    page = visitor.page
    page.goto(f"{stage.dashboard.url}/sessions/{STATION}/{SESSION}", wait_until="commit")
    times = (DRAWN_AT, SEGMENTS_AT, PROGRAM_AT)
    drawn, segments, program = (page.wait_for_function(when).json_value() for when in times)
    page.wait_for_timeout(1000)  # the page is at rest
    zooms = [page.evaluate(ZOOM) for _ in range(ZOOMS)]
    print(*visitor.errors, sep="\n", end="", flush=True)
    visitor.close()
    return drawn / 1000, segments / 1000, program / 1000, [took / 1000 for took in zooms]


def main() -> None:
    """Teach, begin anew, look, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--pages", type=int, default=5)
    parser.add_argument("--folder", type=Path, help="keeps what was taught, or has it from a run before")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.folder or Path(temporary)
        if not (folder / "journal").exists():
            folder.mkdir(exist_ok=True)
            teach(folder, options.seconds)
        with staged(folder) as stage, chromium() as browser:
            found = [looked_at(stage, browser) for _ in range(options.pages)]
    for number, (drawn, segments, program, zooms) in enumerate(found, 1):
        print(f"page {number}: first picture {drawn:.2f} s, segments {segments:.2f} s, ", end="")
        print(f"program {program:.2f} s, ", end="")
        print(f"zoom {np.median(zooms):.3f} s, longest {max(zooms):.3f} s")
    zooms = [took for *_, own in found for took in own]
    first_s, share = np.median([drawn for drawn, *_ in found]), np.mean(np.array(zooms) <= WANTED_ZOOM_S)
    print(f"first picture: {first_s / WANTED_FIRST_S:.2f} of the {WANTED_FIRST_S:g} s that are wanted")
    print(f"zoom: {np.median(zooms) / WANTED_ZOOM_S:.2f} of {WANTED_ZOOM_S:g} s, {share:.0%} within it")


if __name__ == "__main__":
    main()
