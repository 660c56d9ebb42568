"""Compresses the static files of the pages, and the samples that they draw: a page stays below 1 MB.

A file is compressed once. Samples are compressed for each response, fast and a little less.
"""

from __future__ import annotations

import asyncio
import gzip
import re
from collections.abc import Iterable
from contextlib import suppress

from starlette.datastructures import Headers, MutableHeaders
from starlette.middleware.gzip import GZipMiddleware
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LEVEL = 6  # of gzip: 9 takes twice as long for a hundredth less
FAST_LEVEL, LEAST_BYTES = 1, 1 << 14  # of samples: 0.6 MB take 10 ms
PREPARE_AFTER_S = 0.1  # of the start: a dashboard is ready first
MOST_ANSWERS = 200  # that are kept: thrice the files that there are
CONDITIONS = {"range", "if-none-match", "if-modified-since"}  # headers that ask for less than the file

REQUEST: Scope = {  # of a browser on this machine
    "http_version": "1.1",
    "method": "GET",
    "scheme": "http",
    "query_string": b"",
    "root_path": "",
    "client": ("127.0.0.1", 0),
    "server": ("127.0.0.1", 0),
    "headers": [(b"host", b"127.0.0.1"), (b"accept-encoding", b"gzip, deflate, br, zstd")],
}


def compressed(answer: Response, accepted: str) -> Response:
    """Return a response compressed, if it has LEAST_BYTES and gzip is accepted; else as it is."""
    if "gzip" in accepted and answer.status_code == 200 and len(answer.body) >= LEAST_BYTES:
        answer.body = gzip.compress(answer.body, FAST_LEVEL)
        answer.headers["content-encoding"] = "gzip"
        answer.headers["content-length"] = str(len(answer.body))
    return answer


def _asked() -> Receive:
    """Return an ASGI request message without content, for a client that does not disconnect."""
    messages: list[Message] = [{"type": "http.request", "body": b"", "more_body": False}]

    async def receive() -> Message:
        if not messages:
            await asyncio.Event().wait()
        return messages.pop()

    return receive


async def _dropped(_message: Message) -> None:
    """Discard an ASGI message: no browser receives it."""


class FileCompression(GZipMiddleware):
    """ASGI middleware that compresses the files that a browser caches. paths: prefixes of their paths.

    Each file is read and compressed once: the response stays in memory until the process ends. prepared: path
    of a page that is built, and whose files are compressed, when the application starts, before the first
    request. modules: further files of an import map, each by the name of its package and its path there.
    """

    def __init__(
        self,
        app: ASGIApp,
        paths: tuple[str, ...],
        prepared: str | None = None,
        modules: Iterable[tuple[str, str]] = (),
    ) -> None:
        super().__init__(app, compresslevel=LEVEL)
        self._paths = paths
        self._prepared, self._modules = prepared, tuple(modules)
        self._answers: dict[tuple[str, bool], list[Message]] = {}  # by path, and whether gzip is accepted

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send a compressed response, or pass the request on to the application."""
        if scope["type"] == "lifespan" and self._prepared is not None:
            over, preparing = asyncio.Event(), list[asyncio.Task[None]]()

            async def send_and_prepare(message: Message) -> None:
                await send(message)
                if message["type"] == "lifespan.startup.complete":
                    preparing.append(asyncio.create_task(self._prepare(scope, over)))

            await self.app(scope, receive, send_and_prepare)
            over.set()
            await asyncio.gather(*preparing, return_exceptions=True)  # a file that is being read is closed
            return
        if scope["type"] != "http" or not scope["path"].startswith(self._paths):
            await self.app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        if scope["method"] != "GET" or CONDITIONS & set(headers):
            await super().__call__(scope, receive, send)
            return
        key = scope["path"], "gzip" in headers.get("accept-encoding", "")
        answer = self._answers.get(key)
        if answer is None:
            answer = await self._read(scope, receive)
            if answer[0]["status"] == 200 and len(self._answers) < MOST_ANSWERS:
                self._answers[key] = answer
        for message in answer:
            await send(dict(message))  # outer middleware adds headers

    async def _prepare(self, started: Scope, over: asyncio.Event) -> None:
        """Build the prepared page, and cache its files. over: set when the application ends."""
        page: list[bytes] = []

        async def keep(message: Message) -> None:
            page.append(message.get("body", b""))

        def request(path: str) -> Scope:
            return {**REQUEST, **started, "type": "http", "path": path, "raw_path": path.encode()}

        assert self._prepared is not None
        with suppress(TimeoutError):
            await asyncio.wait_for(over.wait(), PREPARE_AFTER_S)
        if not over.is_set():
            await self.app(request(self._prepared), _asked(), keep)
        for path in sorted(self._files_of(b"".join(page).decode())):
            await asyncio.sleep(0)  # what a browser asks for comes first
            if over.is_set():
                return
            await self(request(path), _asked(), _dropped)

    def _files_of(self, page: str) -> set[str]:
        """Return the paths of the files and modules that a page loads; its import map lists many more."""
        named = set(re.findall(r"""(?:href=|src=|from )["'](/[^"'\s?]+)[?"']""", page))
        for package, path in self._modules:
            found = re.search(rf'"{re.escape(package)}/": ?"(/[^"]+)"', page)
            named |= {found[1] + path} if found else set()
        return {path for path in named if path.startswith(self._paths)}

    async def _read(self, scope: Scope, receive: Receive) -> list[Message]:
        """Return the messages of a response, with its whole body in one message."""
        answer: list[Message] = []

        async def keep(message: Message) -> None:
            answer.append(message)

        await super().__call__(scope, receive, keep)
        body = b"".join(message.get("body", b"") for message in answer[1:])
        if len(answer) > 2:  # it came in parts, of a length that was not known before
            MutableHeaders(raw=answer[0]["headers"])["content-length"] = str(len(body))
        return [answer[0], {"type": "http.response.body", "body": body}]
