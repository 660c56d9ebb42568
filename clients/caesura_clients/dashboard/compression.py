"""Files of the pages, compressed on their way: a page stays below 1 MB. What changes is sent as it is."""

from __future__ import annotations

from starlette.datastructures import Headers, MutableHeaders
from starlette.middleware.gzip import GZipMiddleware
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LEVEL = 6  # of gzip: 9 takes twice as long for a hundredth less
MOST_ANSWERS = 200  # that are kept: thrice the files that there are
CONDITIONS = {"range", "if-none-match", "if-modified-since"}  # headers that ask for less than the file


class FileCompression(GZipMiddleware):
    """Compresses what is loaded once and kept by the browser. paths: how their paths begin.

    Each file is read and compressed once: an answer stays in memory until the process ends.
    """

    def __init__(self, app: ASGIApp, paths: tuple[str, ...]) -> None:
        super().__init__(app, compresslevel=LEVEL)
        self._paths = paths
        self._answers: dict[tuple[str, bool], list[Message]] = {}  # by path, and whether gzip is accepted

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer compressed, or hand on."""
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
            await send(dict(message))  # what stands around this adds headers

    async def _read(self, scope: Scope, receive: Receive) -> list[Message]:
        """The messages of an answer, its body as one."""
        answer: list[Message] = []

        async def keep(message: Message) -> None:
            answer.append(message)

        await super().__call__(scope, receive, keep)
        body = b"".join(message.get("body", b"") for message in answer[1:])
        if len(answer) > 2:  # it came in parts, of a length that was not known before
            MutableHeaders(raw=answer[0]["headers"])["content-length"] = str(len(body))
        return [answer[0], {"type": "http.response.body", "body": body}]
