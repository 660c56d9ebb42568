"""Which commands there are: those of what is installed, and what to install for the others."""

from importlib.metadata import EntryPoint

import pytest
import typer
from typer.testing import CliRunner

from caesura_clients.cli import build
from caesura_clients.cli.sessions import stand_in


def entry(value):
    return EntryPoint(name="x", value=value, group="caesura.commands")


def test_the_command_line_assembles_itself_from_what_is_installed():
    app = build([entry("caesura_clients.cli.commands:register")])
    result = CliRunner().invoke(app, ["--help"])
    for command in ("bridge", "watch", "program", "sessions"):
        assert command in result.stdout


@pytest.fixture
def client_only(monkeypatch, tmp_path):
    """The command line where an entry point needs a library that is not installed."""
    (tmp_path / "needs_an_extra.py").write_text("import a_library_that_is_not_installed\n")
    monkeypatch.syspath_prepend(tmp_path)
    return build([entry("needs_an_extra:register"), entry("caesura_clients.cli.commands:register")])


def test_commands_whose_extra_is_missing_are_not_listed(client_only, capsys):
    assert capsys.readouterr() == ("", "")
    listed = CliRunner().invoke(client_only, ["--help"]).stdout
    assert "bridge" in listed
    for command in ("serve", "segment", "demo", "evaluate", "report", "teach"):
        assert f" {command} " not in listed


@pytest.mark.parametrize(
    ("typed", "extra"),
    [
        (["serve", "--listen", "tcp/0.0.0.0:7447"], "service"),
        (["segment", "a.npz", "--json", "b.json"], "service"),
        (["demo", "--fast"], "service"),
        (["evaluate", "--help"], "service"),
        (["report", "a.npz", "-o", "b.pdf"], "service"),
        (["teach"], "teacher"),
        (["annotate", "a.npz"], "service,dashboard"),
    ],
)
def test_typing_one_is_given_the_command_that_installs_it(client_only, typed, extra):
    # "No such command" was once all that a client install had to say.
    result = CliRunner().invoke(client_only, typed)
    assert result.exit_code == 2
    assert (
        result.stderr == f"error: caesura {typed[0]} needs pip install '.[{extra}]' in a clone of Caesura\n"
    )


def test_what_is_installed_has_no_stand_in():
    pytest.importorskip("caesura_service.commands")
    assert not any(info.hidden for info in build().registered_commands)


def test_an_own_module_that_is_missing_is_no_extra(monkeypatch, tmp_path):
    (tmp_path / "broken.py").write_text("import caesura_clients.a_module_that_is_not_there\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ModuleNotFoundError, match="a_module_that_is_not_there"):
        build([entry("broken:register")])


@pytest.mark.parametrize("name", ["export", "delete", "journals"])
def test_what_needs_the_journal_says_where_it_runs(name: str):
    group = typer.Typer()
    group.command("list")(lambda: None)
    group.command("show")(lambda: None)
    stand_in(group)
    result = CliRunner().invoke(group, [name, "s1", "--station", "cell-1", "-o", "x.npz"])
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr == (
        f"error: caesura sessions {name} runs on the service's machine, where the journal is; "
        "it comes with pip install '.[service]' in a clone of Caesura\n"
    )
    before = len(group.registered_commands)
    stand_in(group)
    assert len(group.registered_commands) == before
