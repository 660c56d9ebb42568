"""Labels of the path in three dimensions, in a browser as wide as a phone: whole, and none upon another."""

from __future__ import annotations

import http.server
import json
import math
import re
import threading
from collections.abc import Iterator
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import pytest

pytest.importorskip("playwright", reason="playwright is not installed (extra dev)")
pytest.importorskip("nicegui", reason="nicegui is not installed (extra dashboard)")

import nicegui
from playwright.sync_api import Browser, Page, expect

from caesura_clients.dashboard.web_components import WEB
from dashboard.browser import THEMES, Theme, needs_chromium

pytestmark = needs_chromium
PHONE = {"width": 390, "height": 844}
PAGE = """<!doctype html><link rel="stylesheet" href="/web/style.css">
<script type="importmap">{"imports": {"vue": "/vue.js", "caesura-dashboard/": "/web/"}}</script>
<div id="app" style="padding: 16px"></div><script>
  window.texts = [];
  const canvas = CanvasRenderingContext2D.prototype, { fillText, clearRect } = canvas;
  canvas.clearRect = function (...all) { window.texts = []; clearRect.apply(this, all); };
  canvas.fillText = function (words, x, y) {
    window.texts.push([words, x, y, this.measureText(words).width]);
    fillText.call(this, words, x, y);
  };
</script><script type="module">
  import { createApp, h, shallowRef } from "vue";
  import Path from "caesura-dashboard/program_path.js";
  const rows = window.rows = shallowRef(ROWS);
  createApp({ render: () => h(Path, { rows: rows.value, speeds: [], elsewhere: false }) }).mount("#app");
</script>"""
HIGH_PX = 12.0  # of a text, about its middle


class Text(NamedTuple):
    words: str
    x: float
    y: float
    width: float

    def meets(self, other: Text) -> bool:
        beside = self.x + self.width <= other.x or other.x + other.width <= self.x
        return not beside and abs(self.y - other.y) < HIGH_PX


def row(number: int, *places: tuple[float, float, float], force: list[float] | None = None) -> dict[str, Any]:
    points = [[number + 0.5 * i, *place] for i, place in enumerate(places)]
    kind = "motion" if force is None else "sliding"
    return {"number": number, "words": "app", "kind": kind, "points": points, "via": [], "force": force}


def strokes() -> list[dict[str, Any]]:
    """A reach, strokes with a press that end close together at the edge of the picture, and a way back."""
    pressed = [
        row(2 + k, (8.0 * k, 150.0, 0.0), (8.0 * k + 4.0, 158.0, 0.0), force=[0.0, 0.0, -12.0 - k])
        for k in range(7)
    ]
    return [
        row(1, (0.0, 0.0, 120.0), (0.0, 150.0, 0.0)),
        *pressed,
        row(9, (52.0, 158.0, 0.0), (60.0, 0.0, 120.0)),
    ]


class Web(http.server.SimpleHTTPRequestHandler):
    """The page, the components beside it, and Vue as the dashboard serves it."""

    def do_GET(self) -> None:
        if self.path == "/":
            content, kind = PAGE.replace("ROWS", json.dumps(strokes())).encode(), "text/html"
        elif self.path == "/vue.js":
            vue = Path(nicegui.__file__).parent / "static" / "vue.esm-browser.prod.js"
            content, kind = vue.read_bytes(), "text/javascript"
        else:
            super().do_GET()
            return
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, *words: object) -> None:
        """Nothing."""


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("web")
    (folder / "web").symlink_to(WEB)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), partial(Web, directory=str(folder))) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()
        thread.join()


@pytest.fixture(scope="module")
def loaded(browser: Browser, url: str) -> Iterator[Page]:
    page = browser.new_page(viewport=PHONE)
    page.goto(url)
    yield page
    page.close()


@pytest.fixture
def page(loaded: Page) -> Page:
    """The page with the strokes."""
    show(loaded, strokes())
    return loaded


def show(page: Page, rows: list[dict[str, Any]]) -> None:
    page.evaluate("(rows) => { window.rows.value = rows; }", rows)


def drawn(page: Page) -> list[Text]:
    """What is written in the drawing two frames from now."""
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return [Text(*one) for one in page.evaluate("window.texts")]


@pytest.mark.parametrize("theme", THEMES)
@pytest.mark.parametrize("view", ["3D", "top", "front", "side"])
def test_labels_of_a_path_are_whole_and_apart_on_a_phone(page: Page, view: str, theme: Theme):
    page.evaluate("(theme) => document.documentElement.dataset.theme = theme", theme)
    page.get_by_role("button", name=view, exact=True).click()
    texts = drawn(page)
    width, height = page.locator("canvas").evaluate("(canvas) => [canvas.clientWidth, canvas.clientHeight]")
    assert any(one.words.startswith("1") for one in texts), "the first app has its number"
    assert any(one.words.endswith(" N") for one in texts) or view == "top", "forces have their sizes"
    for one in texts:
        assert 0.0 <= one.x <= one.x + one.width <= width, one
        assert HIGH_PX / 2 <= one.y <= height - HIGH_PX / 2, one
    assert [(one, other) for one, other in combinations(texts, 2) if one.meets(other)] == []


def crowd(count: int) -> list[dict[str, Any]]:
    """A spiral whose apps end close together; each third presses."""
    targets = [(0.0, 0.0, 50.0)]
    for k in range(count):
        angle, radius = 0.35 * k, 40.0 + 2.2 * k
        height = 0.0 if k % 3 else 40.0
        targets.append((radius * math.cos(angle), radius * math.sin(angle), height))
    force = [0.0, 0.0, -8.0]
    return [row(k + 1, targets[k], targets[k + 1], force=force if k % 3 == 1 else None) for k in range(count)]


# Where the targets of the apps are in the drawing [px].
TARGETS = """() => {
  const canvas = document.querySelector("canvas"), { rows, projection } = canvas.path;
  const { of } = projection(canvas.clientWidth, canvas.clientHeight);
  return rows.map(({ points }) => of(points.at(-1).slice(1)));
}"""
FEWEST, MOST = 15, 50  # of 100 numbers


def test_numbers_of_a_hundred_apps_leave_the_path_to_be_seen(page: Page):
    """All of them were written, up to 32 px from their targets: which was whose could not be seen."""
    page.get_by_role("button", name="3D", exact=True).click()
    show(page, crowd(100))
    targets = page.evaluate(TARGETS)
    time = page.get_by_role("slider")
    for number in (100, 41, 1):
        time.fill(str(number + 0.25))
        texts = drawn(page)
        assert [one for one in texts if one.words == str(number)], "the chosen one"
        assert [(one, other) for one, other in combinations(texts, 2) if one.meets(other)] == []
        others = [one for one in texts if one.words[0].isdigit() and one.words != str(number)]
        assert FEWEST < len(others) < MOST
        for one in others:
            assert not any(covers(one, *target) for target in targets), one


def covers(text: Text, x: float, y: float) -> bool:
    return text.x < x < text.x + text.width and abs(text.y - y) < HIGH_PX / 2


def test_the_number_of_an_app_stands_at_its_target(page: Page):
    """It stood where the app begins: 3 at the target of app 2."""
    press = row(1, (0.0, 0.0, 0.0), (0.0, 300.0, 0.0), force=[0.0, 0.0, -12.0])
    page.get_by_role("button", name="3D", exact=True).click()
    show(page, [press])
    (number,) = [one for one in drawn(page) if one.words == "1"]
    (force,) = [one for one in drawn(page) if one.words == "12.0 N"]
    apart_px = math.hypot(number.x - force.x, number.y - force.y)
    assert apart_px < PHONE["width"] / 3, "the arrow begins at the target; the path is twice as long"


def test_an_app_is_drawn_as_soon_as_the_words_name_it(page: Page):
    """It was drawn up to a second later: "3 move" stood above a path of two apps."""
    assert "10" not in numbers(drawn(page))
    show(page, [*strokes(), row(10, (60.0, 0.0, 120.0), (160.0, 0.0, 120.0))])
    assert "10" in numbers(drawn(page))
    assert " 10 app " in page.locator("output").inner_text()


def numbers(texts: list[Text]) -> set[str]:
    return {number for one in texts for number in re.split("[–, ]+", one.words)}


def test_no_zero_of_a_place_has_a_sign(page: Page):
    show(page, [row(1, *[(300.0, -0.2, 400.0)] * 2)])
    expect(page.locator("output")).to_contain_text("(300, 0, 400) mm")
