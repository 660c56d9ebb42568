"""What `caesura dashboard` refuses before it listens."""

from __future__ import annotations

import socket

import pytest
import typer
from typer.testing import CliRunner

from caesura_clients.dashboard.command_registration import register
from clients.conftest import free_port


@pytest.fixture
def app():
    pytest.importorskip("nicegui")
    app = typer.Typer()
    app.callback()(lambda: None)
    register(app)
    return app


def refused(app, *options):
    result = CliRunner().invoke(app, ["dashboard", "--connect", f"tcp/127.0.0.1:{free_port()}", *options])
    assert result.exit_code != 0
    return " ".join(result.output.split())


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.10", "::"])
def test_where_others_reach_it_it_demands_a_password(app, host):
    said = refused(app, "--host", host)
    assert "--password-file" in said
    assert "--insecure" in said


def test_a_password_has_a_length(app, tmp_path):
    file = tmp_path / "password"
    file.write_text("short\n")
    assert "has 5 characters, expected 8 at least" in refused(app, "--password-file", str(file))


def test_a_port_that_is_taken_is_named(app):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert f"127.0.0.1:{port}" in refused(app, "--port", str(port))
