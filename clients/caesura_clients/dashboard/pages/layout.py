"""The common parts of every page: theme, name, navigation, and network trouble."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

from nicegui import ui
from nicegui.element import Element
from nicegui.elements.mixins.text_element import TextElement

from caesura_clients.dashboard.correction_requests import Corrector
from caesura_clients.dashboard.demonstration_requests import DemonstrationDesk
from caesura_clients.dashboard.network_follower import NetworkFollower
from caesura_clients.dashboard.program_simulation import Simulator
from caesura_clients.dashboard.recordings import RecordingDesk
from caesura_clients.dashboard.web_components import WEB

ASSETS = "/assets"
TICK_S = 0.1  # updates of a page; ten a second at most
SLOW_TICK_S = 1.0
MENU = (("/", "Stations"), ("/sessions", "Sessions"), ("/recordings", "Recordings"), ("/system", "System"))
STYLES = ("vendor/uplot/uPlot.min.css", "style.css", "session.css", "hints.css")


def asset_url(path: str) -> str:
    """Return the URL of a file of `web` with a digest of its content: a browser keeps files for an hour."""
    return f"{ASSETS}/{path}?{hashlib.blake2b((WEB / path).read_bytes(), digest_size=4).hexdigest()}"


HEAD = (
    f'<script src="{asset_url("theme.js")}"></script><script src="{asset_url("login.js")}" defer></script>'
    + "".join(f'<link rel="stylesheet" href="{asset_url(path)}">' for path in STYLES)
    + '<meta name="robots" content="noindex">'
)


class Site(NamedTuple):
    """The objects that pages use. Those after `gateway` are None if this dashboard is read-only."""

    gateway: NetworkFollower
    corrector: Corrector | None
    desk: DemonstrationDesk | None = None
    recordings: RecordingDesk | None = None
    simulator: Simulator | None = None


class Title:
    """The title of a page, which is also that of the browser's tab."""

    def __init__(self, title: str) -> None:
        with Element("h1"):
            self._title, self._beside = text("span", ""), text("small", "")
        self.say(title)

    def say(self, title: str, beside: str = "") -> None:
        """Show the title. beside: what stands small beside it."""
        beside = f" · {beside}" if beside else ""
        if (title, beside) != (self._title.text, self._beside.text):
            self._title.set_text(title)
            self._beside.set_text(beside)
            ui.page_title(f"{title}{beside} · Caesura")


@contextmanager
def page(title: str, here: str) -> Iterator[Title]:
    """Build the frame around a page's content. here: the menu's entry of this page."""
    ui.add_head_html(HEAD)
    with ui.header(wrap=False, fixed=False), Element("div").classes("bar-top"):
        text("span", "Caesura").classes("name")
        with Element("nav").props('aria-label="Pages"'):
            for path, name in MENU:
                link = text("a", name).props(f'href="{path}"')
                if path == here:
                    link.props('aria-current="page"')
        theme = Element("button").classes("theme").props('type="button" aria-label="Light or dark"')
        with theme:
            text("span", "Light or dark").classes("theme-words")
            text("span", "◐").classes("theme-sign").props('aria-hidden="true"')
        theme.on("click", js_handler="() => window.caesuraTheme()")
    yield Title(title)


def text(tag: str, words: str) -> TextElement:
    """Build an HTML element that contains text."""
    return TextElement(tag=tag, text=words)


class Banner:
    """A warning on a page, shown while its cause lasts."""

    def __init__(self) -> None:
        with Element("div").props('role="alert"'):
            self._label = text("p", "").classes("banner")
        self._label.set_visibility(False)

    def say(self, words: str) -> None:
        """Show the text; hide the banner if the text is empty."""
        if words != self._label.text:
            self._label.set_text(words)
            self._label.set_visibility(bool(words))
