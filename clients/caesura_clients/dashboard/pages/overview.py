"""The page `/`: a card for each station."""

from __future__ import annotations

from typing import Any

from nicegui import ui

from caesura_clients.dashboard.pages.layout import TICK_S, Banner, Site, page
from caesura_clients.dashboard.station_summary import glances, summary
from caesura_clients.dashboard.web_components import Overview


def build(site: Site) -> None:
    """Build the page `/` with a card of each station."""
    with page("Stations", "/"):
        banner = Banner()
        cards = Overview(_shown(site))

    def tick() -> None:
        banner.say(site.gateway.world.trouble)
        cards.show(_shown(site))

    ui.timer(TICK_S, tick)


def _shown(site: Site) -> dict[str, Any]:
    gateway = site.gateway
    found = glances(gateway.world, gateway.received, gateway.clock(), gateway.began)
    return {
        "stations": [one.drawn() for one in found],
        "summary": summary(gateway.world, found),
        "answers": bool(gateway.world.alive),
    }
