"""The common parts of every page: theme, name, navigation, and network trouble."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

from nicegui import ui
from nicegui.element import Element
from nicegui.elements.mixins.text_element import TextElement

from caesura_clients.dashboard.correction_requests import Corrector
from caesura_clients.dashboard.demonstration_control import DemonstrationDesk
from caesura_clients.dashboard.network_follower import NetworkFollower
from caesura_clients.dashboard.program_simulation import Simulator
from caesura_clients.dashboard.recordings import RecordingDesk

ASSETS = "/assets"
TICK_S = 0.1  # updates of a page; ten a second at most
SLOW_TICK_S = 1.0
MENU = (("/", "Stations"), ("/sessions", "Sessions"), ("/recordings", "Recordings"), ("/system", "System"))
_HEAD = (
    f'<script src="{ASSETS}/theme.js"></script>'
    f'<script src="{ASSETS}/login.js" defer></script>'
    f'<link rel="stylesheet" href="{ASSETS}/vendor/uplot/uPlot.min.css">'
    f'<link rel="stylesheet" href="{ASSETS}/style.css">'
    f'<link rel="stylesheet" href="{ASSETS}/session.css">'
    f'<link rel="stylesheet" href="{ASSETS}/hints.css">'
    '<meta name="robots" content="noindex">'
)


class Site(NamedTuple):
    """The objects that pages use. Those after `gateway` are None if this dashboard is read-only."""

    gateway: NetworkFollower
    corrector: Corrector | None
    desk: DemonstrationDesk | None = None
    recordings: RecordingDesk | None = None
    simulator: Simulator | None = None


@contextmanager
def page(title: str, here: str) -> Iterator[None]:
    """Build the frame around a page's content. here: the menu's entry of this page."""
    ui.page_title(f"{title} · Caesura")
    ui.add_head_html(_HEAD)
    with ui.header(wrap=False, fixed=False), Element("div").classes("bar-top"):
        text("span", "Caesura").classes("name")
        with Element("nav").props('aria-label="Pages"'):
            for path, name in MENU:
                link = text("a", name).props(f'href="{path}"')
                if path == here:
                    link.props('aria-current="page"')
        theme = text("button", "Light or dark").classes("theme").props('type="button"')
        theme.on("click", js_handler="() => window.caesuraTheme()")
    text("h1", title)
    yield


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
