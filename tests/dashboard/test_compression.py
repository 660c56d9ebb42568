"""Files of the pages: compressed once, and answered from memory."""

from __future__ import annotations

import asyncio
import re

import httpx
import pytest
from starlette.applications import Starlette
from starlette.responses import FileResponse, HTMLResponse
from starlette.routing import Route

from caesura_clients.dashboard.compression import FileCompression
from caesura_clients.dashboard.pages import layout
from dashboard.conftest import ran

TEXT = "let a = 1;\n" * 20_000  # more than a file is read at once


@pytest.fixture
def asked():
    return []


class UncachedBrowser:
    """A browser without a cache. app: that it asks."""

    def __init__(self, app):
        self._app = app

    def get(self, path, **more):
        async def got():
            transport = httpx.ASGITransport(self._app)
            async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
                return await client.get(path, **more)

        return ran(got())


@pytest.fixture
def client(asked, tmp_path):
    file = tmp_path / "one.js"
    file.write_text(TEXT)

    async def answer(request):
        asked.append(request.url.path)
        return FileResponse(file, status_code=404 if "missing" in request.url.path else 200)

    app = Starlette(routes=[Route("/{path:path}", answer)])
    return UncachedBrowser(FileCompression(app, ("/assets/",)))


def test_a_file_is_read_once_and_comes_compressed_each_time(client, asked):
    answers = [client.get("/assets/one.js") for _ in range(3)]
    assert [one.text for one in answers] == [TEXT] * 3
    assert {one.headers["content-encoding"] for one in answers} == {"gzip"}
    assert {int(one.headers["content-length"]) < len(TEXT) / 10 for one in answers} == {True}
    assert asked == ["/assets/one.js"]


def test_who_takes_no_gzip_gets_the_file_as_it_is(client):
    client.get("/assets/one.js")
    answer = client.get("/assets/one.js", headers={"accept-encoding": "identity"})
    assert "content-encoding" not in answer.headers
    assert answer.text == TEXT


def test_a_part_of_a_file_is_not_kept_and_nor_is_a_missing_one(client, asked):
    part = client.get("/assets/one.js", headers={"range": "bytes=0-9"})
    assert part.status_code == 206
    assert client.get("/assets/one.js").text == TEXT
    assert [client.get("/assets/missing").status_code for _ in range(2)] == [404, 404]
    assert len(asked) == 4


def test_what_changes_is_handed_on(client, asked):
    answers = [client.get("/samples") for _ in range(2)]
    assert "content-encoding" not in answers[0].headers
    assert len(asked) == 2


PAGE = """<link href="/assets/one.css?e0f1"><script src="/samples/one.js"></script>
<script type="importmap">{"imports": {"own/": "/assets/key/", "other": "/assets/other.js"}}</script>"""


def test_the_files_of_a_page_are_compressed_before_a_browser_asks(asked, tmp_path):
    """Those that it loads and its modules, of the paths that are compressed; not all of an import map."""
    file = tmp_path / "one"
    file.write_text(TEXT)

    async def answer(request):
        asked.append(request.url.path)
        return HTMLResponse(PAGE) if request.url.path == "/page" else FileResponse(file)

    inner = Starlette(routes=[Route("/{path:path}", answer)])
    app = FileCompression(inner, ("/assets/",), prepared="/page", modules=[("own", "two.js")])
    sent = []
    files = ["/assets/key/two.js", "/assets/one.css"]

    async def send(message):
        sent.append((message["type"], list(asked)))

    async def receive():
        if not sent:
            return {"type": "lifespan.startup"}
        async with asyncio.timeout(30.0):
            while asked != ["/page", *files]:
                await asyncio.sleep(0.005)
        return {"type": "lifespan.shutdown"}

    ran(app({"type": "lifespan", "asgi": {"version": "3.0"}, "state": {}}, receive, send))
    assert sent[0] == ("lifespan.startup.complete", [])
    answer_kept = UncachedBrowser(app).get("/assets/key/two.js")
    assert answer_kept.text == TEXT
    assert answer_kept.headers["content-encoding"] == "gzip"
    assert asked == ["/page", *files]


def test_a_file_of_another_version_has_another_address(monkeypatch, tmp_path):
    """A browser keeps a file for an hour: after an update, pages had the styles of the version before."""
    monkeypatch.setattr(layout, "WEB", tmp_path)
    urls = []
    for content in ("a {}", "b {}", "a {}"):
        (tmp_path / "style.css").write_text(content)
        urls.append(layout.asset_url("style.css"))
    assert urls[0] == urls[2] != urls[1]
    named = re.findall(r'"(/assets/[^"]+)"', layout.HEAD)
    assert len(named) == 2 + len(layout.STYLES)
    assert all(re.fullmatch(r"[^?]+\?[0-9a-f]{8}", one) for one in named)
