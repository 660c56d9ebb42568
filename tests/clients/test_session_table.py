"""The list of sessions, on a terminal of any width and in a pipe."""

import io
from dataclasses import replace
from datetime import datetime

import pytest
from rich.console import Console

from caesura_clients.cli.session_table import print_sessions
from caesura_clients.query import SessionInfo


def listed(infos, width=None):
    """The list of sessions as a terminal of this width shows it; None: a pipe."""
    out = io.StringIO()
    print_sessions(infos, Console(file=out, width=width, force_terminal=width is not None, color_system=None))
    return out.getvalue()


def infos_of(*changes):
    return [
        SessionInfo(
            "cell-1", f"s20261125-00044{i}-ab1{i}", "closed", 123.45, 17, "i1", opened=1.7e9, **change
        )
        for i, change in enumerate(changes)
    ]


@pytest.mark.parametrize("width", [40, 80, 120, None])
@pytest.mark.parametrize("change", [{}, {"task": "wipe the table", "success": True}])
def test_a_list_of_sessions_has_whole_names_and_when_each_was_opened(width, change):
    infos = [*infos_of({}, change), replace(infos_of({})[0], session="x", instance="i2")]
    shown = listed(infos, width)
    assert all(one.session in shown for one in infos)
    assert shown.count(f"{datetime.fromtimestamp(1.7e9):%Y-%m-%d %H:%M}") == 3
    assert "…" not in shown


def test_a_list_of_sessions_states_which_columns_have_no_room():
    infos = infos_of({"task": "wipe the table", "success": True})
    assert "no room for segments, t [s]: --json has all" in listed(infos, 80)
    for roomy in (listed(infos, 120), listed(infos), listed(infos_of({}), 80)):
        assert "segments" in roomy
        assert "no room" not in roomy
    assert max(map(len, listed(infos, 80).splitlines())) <= 80


def test_a_list_of_sessions_shows_the_instance_only_where_there_are_several():
    assert "instance" not in listed(infos_of({}, {}), 200)
    assert "instance" in listed([*infos_of({}), replace(infos_of({})[0], instance="i2")], 200)
