"""The login of a running dashboard: no visitor chooses the address that waits."""

from __future__ import annotations

import urllib.error
import urllib.request

import pytest

pytest.importorskip("nicegui")

from dashboard.stage import Dashboard
from harness.processes import running, serving


class Staying(urllib.request.HTTPRedirectHandler):
    """Follows nothing."""

    def redirect_request(self, *_):
        return None


OPENER = urllib.request.build_opener(Staying)


def log_in(url, password, forwarded):
    headers = {"X-Forwarded-For": forwarded}
    request = urllib.request.Request(f"{url}/login", f"password={password}".encode(), headers)
    try:
        return OPENER.open(request, timeout=30).status
    except urllib.error.HTTPError as answer:
        return answer.code


def test_x_forwarded_for_does_not_evade_the_delay_unless_its_proxy_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv("FORWARDED_ALLOW_IPS", "*")
    file = tmp_path / "password"
    file.write_text("correct horse\n")
    options = ("--password-file", str(file))
    with serving(tmp_path / "journal") as service:
        with running(Dashboard(service.endpoint, *options)) as dashboard:
            found = [log_in(dashboard.url, "wrong", f"10.0.0.{number}") for number in range(20)]
            assert found.count(401) < 20
            assert 429 in found
        with running(Dashboard(service.endpoint, *options, "--proxy", "127.0.0.1")) as dashboard:
            found = [log_in(dashboard.url, "wrong", f"10.0.0.{number}") for number in range(20)]
            assert found == 20 * [401]
            assert log_in(dashboard.url, "correct+horse", "10.0.0.1, 10.0.0.77") == 303
