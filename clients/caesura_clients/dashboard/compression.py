"""Files of the pages, compressed on their way: a page stays below 1 MB. What changes is sent as it is."""

from __future__ import annotations

from starlette.middleware.gzip import GZipMiddleware
from starlette.types import ASGIApp, Receive, Scope, Send

LEVEL = 6  # of gzip: 9 takes twice as long for a hundredth less


class FileCompression(GZipMiddleware):
    """Compresses what is loaded once and kept by the browser. paths: how their paths begin."""

    def __init__(self, app: ASGIApp, paths: tuple[str, ...]) -> None:
        super().__init__(app, compresslevel=LEVEL)
        self._paths = paths

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer compressed, or hand on."""
        is_file = scope["type"] == "http" and scope["path"].startswith(self._paths)
        await (super().__call__ if is_file else self.app)(scope, receive, send)
