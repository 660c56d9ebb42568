"""Pages shown in place of a path that does not exist, or of a file that cannot be written."""

from __future__ import annotations

from caesura_clients.dashboard.pages.layout import page, text


def build(path: str, why: str) -> None:
    """Build the page for a path that does not exist. why: the reason that the server gives."""
    with page("Page not found", ""):
        text("p", f"There is no page {path}." if why == "Not Found" else f"{path}: {why}.")
        text("a", "Go to the stations").props('href="/"')


def build_refusal(why: str, back: str) -> None:
    """Build the page for a file that cannot be written. back: address to which its link leads."""
    with page("Not exported", ""):
        text("p", f"{why}.")
        text("a", "Go back").props(f'href="{back}"')
