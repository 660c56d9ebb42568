"""Chromium as the tests drive it, what it is asked for, and the pictures that it leaves behind."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal
from urllib.parse import urlsplit

import pytest
from axe_playwright_python.base import AXE_SCRIPT
from playwright.sync_api import (
    Browser,
    Error,
    Page,
    Request,
    ViewportSize,
    WebSocket,
    WebSocketRoute,
    sync_playwright,
)

from harness.processes import eventually

# Chromium built without windows: it draws a page in two thirds of the processor time. Any Chromium does.
BROWSERS = [Path("/usr/bin/chromium-headless-shell"), Path("/usr/bin/chromium")]
if "CAESURA_CHROMIUM" in os.environ:
    BROWSERS = [Path(os.environ["CAESURA_CHROMIUM"])]
CHROMIUM = next((path for path in BROWSERS if path.exists()), None)
needs_chromium = pytest.mark.skipif(
    CHROMIUM is None,
    reason=f"no {' and no '.join(map(str, BROWSERS))}: apt-get install {BROWSERS[0].name}",
)
ARTEFACTS = Path(__file__).parent / "artefacts"
PICTURES = "CAESURA_PICTURES" in os.environ  # each takes half a second of CPU, and no test looks at one
# Without the last four Chromium asks Google's hosts at every start.
FLAGS = (
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
)  # fmt: skip
# V8 compiles no short page for speed, and one thread draws it: an eighth less processor time.
FOR_SHORT_PAGES = ("--js-flags=--no-maglev --no-turbofan --single-threaded-gc", "--num-raster-threads=1")
DESK, TABLET, PHONE = (
    {"width": width, "height": height} for width, height in ((1440, 900), (1180, 820), (390, 844))
)
UPRIGHT = {"width": TABLET["height"], "height": TABLET["width"]}
PATIENCE_MS = 60_000
LOOK_MS = 50  # between two looks of a page at itself; without, it looks at, and draws, every frame meanwhile
# The rule is off by default: a user who speaks to a page says the words on a button.
AXE = {
    "resultTypes": ["violations"],
    "preload": False,
    "rules": {"label-content-name-mismatch": {"enabled": True}},
}
NOTHING_LOADS = """() => [...document.querySelectorAll(".q-loading-bar")]
  .every((bar) => bar.getAttribute("aria-hidden") === "true")"""
FORGET = "() => { if (location.protocol !== 'about:') { localStorage.clear(); sessionStorage.clear(); } }"
# A click of the mouse at a time of the page's clock [ms]; the first one is now.
CLICK = """(button, at) => {
  const { x: clientX, y: clientY } = button.getBoundingClientRect();
  const click = new MouseEvent("click", { clientX, clientY, bubbles: true, cancelable: true, detail: 1 });
  Object.defineProperty(click, "timeStamp", { value: at ?? click.timeStamp });
  button.dispatchEvent(click);
  return click.timeStamp;
}"""
# What is from the cache has no `transferSize`, which is 300 bytes more than a file as it was sent.
RECEIVED = """() => ["navigation", "resource"].flatMap((kind) => performance.getEntriesByType(kind))
  .reduce((sum, entry) => sum + (entry.transferSize || entry.encodedBodySize + 300), 0)"""
# What is read from two metres is left out: the state of a station, and hints.
TYPE_SIZES = """() => {
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT), found = {};
  for (let text = texts.nextNode(); text; text = texts.nextNode()) {
    const element = text.parentElement;
    if (!text.textContent.trim() || !element.checkVisibility()) continue;
    if (element.closest(".desk-state, .badge-said, .hint")) continue;
    found[getComputedStyle(element).fontSize] ??= `${element.tagName}: ${text.textContent.trim()}`;
  }
  for (const field of document.querySelectorAll("input, select, textarea")) {
    if (field.checkVisibility()) found[getComputedStyle(field).fontSize] ??= field.tagName;
  }
  return found;
}"""
Theme = Literal["light", "dark"]
SIZES = {"desktop": DESK, "phone": PHONE}
THEMES: dict[Theme, tuple[str, ...]] = {"light": (), "dark": ("color-contrast",)}  # axe's rules; all, or some


@contextmanager
def chromium(*flags: str) -> Iterator[Browser]:
    """A browser without a screen, with further flags."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, headless=True, args=[*FLAGS, *flags])
        try:
            yield browser
        finally:
            browser.close()


class SlowSocket:
    """What the dashboard sends to a page, which may be held up; from the next load of the page on."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._held: list[str | bytes] | None = None
        self._words = ""
        self._socket: WebSocketRoute | None = None
        page.route_web_socket(re.compile("socket.io"), self._route)

    def hold(self, words: str = "") -> None:
        """Let nothing through that has these words."""
        self._held, self._words = [], words

    def release(self) -> None:
        """Let everything through that was held, without its number.

        A page passes over a message with a lower number than one it has had.
        """
        held, self._held = self._held or [], None
        assert self._socket is not None
        for message in held:
            self._socket.send(re.sub(r',"_id":\d+', "", message) if isinstance(message, str) else message)

    def has_received(self, words: str) -> bool:
        """Is there something with these words among what is held?"""
        self._page.wait_for_timeout(10)  # messages are taken while the page is waited for
        return any(words in str(message) for message in self._held or ())

    def _route(self, socket: WebSocketRoute) -> None:
        self._socket = socket
        server = socket.connect_to_server()
        socket.on_message(server.send)
        server.on_message(self._pass)

    def _pass(self, message: str | bytes) -> None:
        assert self._socket is not None
        if self._held is None or self._words not in str(message):
            self._socket.send(message)
        else:
            self._held.append(message)


# Of an element with plots: what is in sight is loaded, and no drawing of it is due in the next frame.
SETTLED = """({ plots }) => plots && plots.state.data && !plots.state.lacksData() && !plots.state.loading
  && plots.painters.every(({ frame }) => !frame)"""


def settled(page: Page) -> None:
    """Wait until what is in sight is loaded and drawn."""
    page.wait_for_function(f"() => ({SETTLED})(document.querySelector('.plots'))", polling=LOOK_MS)


class Visitor:
    """One page of a browser; remembers what went wrong in it and, if watched, which hosts it asked for."""

    def __init__(self, browser: Browser, theme: Theme = "light", **context: Any) -> None:
        """context: of Playwright, such as `has_touch`."""
        self.theme = theme
        self.hosts: set[str] = set()
        self.errors: list[str] = []
        self._watches_hosts = False
        self._context = browser.new_context(**{"viewport": TABLET, "color_scheme": theme, **context})
        self.page: Page = self._context.new_page()
        self.page.set_default_timeout(PATIENCE_MS)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", lambda said: self._listen(said.type, said.text))

    def close(self) -> None:
        self._context.close()

    def watch_hosts(self) -> None:
        """Collect the hosts of all requests until the page is left.

        Playwright then reports every request to this process: a tenth of what a page costs.
        """
        self._context.on("request", self._ask)
        self.page.on("websocket", self._ask)
        self._watches_hosts = True

    def begin_again(self, size: ViewportSize) -> None:
        """As one who has just come, but for what the browser has in its cache."""
        self.leave()
        self._context.clear_cookies()
        self.page.mouse.move(0, 0)
        self.page.emulate_media(color_scheme="light")
        self.page.set_viewport_size(size)
        self.theme = "light"
        self.errors.clear()
        self.hosts.clear()

    def leave(self) -> None:
        """The browser keeps nothing of the page but its cache, and does not wait for its server."""
        if self._watches_hosts:
            self._context.remove_listener("request", self._ask)
            self.page.remove_listener("websocket", self._ask)
            self._watches_hosts = False
        try:
            self.page.evaluate(FORGET)
        except Error:  # a page whose server began again loads itself anew meanwhile
            self.page.wait_for_load_state()
            self.page.evaluate(FORGET)
        self.page.goto("about:blank")

    def is_called(self, author: str, url: str) -> None:
        """The name is in the browser before the page comes from there that asks for it."""
        self.page.goto(f"{url}/assets/theme.js")
        self.page.evaluate("(author) => localStorage.setItem('caesura-author', author)", author)

    def picture(self, name: str) -> None:
        """Keep what is on the page, to be looked at, where the environment asks for pictures."""
        if PICTURES:
            ARTEFACTS.mkdir(exist_ok=True)
            self.page.screenshot(path=ARTEFACTS / f"{name}-{self.theme}.png", full_page=True)

    def barriers(self, *rules: str, within: str = "html") -> list[str]:
        """What axe finds on the page, or in a part of it; by some of its rules, or by all.

        It fetches nothing: meanwhile Quasar draws a bar without a name, which axe would find.
        """
        assert self.page.locator(within).count() > 0, f"nothing is {within}"
        self.page.wait_for_function(NOTHING_LOADS)
        only = {"runOnly": {"type": "rule", "values": rules}} if rules else {}
        if not self.page.evaluate("() => 'axe' in window"):
            self.page.evaluate(AXE_SCRIPT)
        given = [{"include": [[within]]} if within != "html" else None, {**AXE, **only}]
        found = self.page.evaluate("([part, options]) => axe.run(part ?? document, options)", given)
        return [
            f"{one['id']}: {one['help']}: {[node['target'] for node in one['nodes']][:3]}"
            for one in found["violations"]
        ]

    def received_bytes(self) -> int:
        """How much the page has loaded, as it comes over the network the first time."""
        return int(self.page.evaluate(RECEIVED))

    def sideways_px(self) -> int:
        """By how much the page is wider than the window."""
        root = "document.documentElement"
        return int(self.page.evaluate(f"{root}.scrollWidth - {root}.clientWidth"))

    def type_sizes(self) -> dict[str, str]:
        """The sizes of what is written on the page, also in what is folded; an example of each."""
        self.page.evaluate(
            "() => document.querySelectorAll('details').forEach((one) => { one.open = true; })"
        )
        return dict(self.page.evaluate(TYPE_SIZES))

    def _ask(self, asked: Request | WebSocket) -> None:
        url = urlsplit(asked.url)
        if url.scheme not in {"data", "blob"}:
            self.hosts.add(url.hostname or "")

    def _listen(self, kind: str, text: str) -> None:
        if kind == "error":
            self.errors.append(text)


def looks_right(visitor: Visitor, name: str, within: str = "html") -> None:
    """Light at a desk and dark on a phone axe finds nothing; nothing scrolls sideways, nor on a tablet.

    within: what is new on the page, where a test before has looked at the whole page.
    """
    page = visitor.page
    for (theme, rules), (where, size) in zip(THEMES.items(), SIZES.items(), strict=True):
        page.evaluate("(theme) => document.documentElement.dataset.theme = theme", theme)
        visitor.theme = theme
        page.set_viewport_size(size)
        visitor.picture(f"{name}-{where}")
        assert visitor.barriers(*rules, within=within) == []
        eventually(lambda: visitor.sideways_px() <= 0)  # a menu is put in its place after the window
    page.set_viewport_size(UPRIGHT)
    eventually(lambda: visitor.sideways_px() <= 0)
    page.set_viewport_size(DESK)
