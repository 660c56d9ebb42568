"""A program in words and units."""

from __future__ import annotations

import pytest

from caesura_clients.dashboard.program_timeline import ROWS, Timeline, card, changes, vector
from caesura_protocol.app_kinds import APP_KINDS, AppKind
from caesura_protocol.messages import App, Program
from caesura_protocol.session_time_display import SessionClock
from clients.examples import example


def app(**changes):
    return example(App).model_copy(update=changes)


def lines(one):
    return dict(map(tuple, card(1, one)["lines"]))


def test_every_kind_of_app_has_a_title():
    assert set(APP_KINDS) == set(AppKind.__args__)


def test_what_an_app_does_not_have_is_not_shown():
    bare = app(
        target=None,
        orientation=None,
        force=None,
        force_taught=None,
        load_kg=None,
        load_sd_kg=None,
        gripper_width=None,
        path=None,
        screw=None,
        speed=None,
    )
    assert lines(bare) == {}


def test_targets_forces_speeds_and_loads_have_their_units():
    one = app(
        target=(0.3, -0.1, 0.25), force=(0.0, 0.0, -9.0), force_taught=(0.0, 0.0, -12.0),
        load_kg=0.25, load_sd_kg=0.01, gripper_width=0.04,
    )  # fmt: skip
    assert lines(one) == {
        "target": "(300, -100, 250) mm",
        "orientation": "x 180°, y 0°, z 0°",
        "force": "(0.0, 0.0, -9.0) N, limited to 9.0 N of 12.0 N taught",
        "path": "375 mm, turns 115°, 1 via point, within 1.0 mm",
        "speed": "50 % of the taught one",
        "turn": "115° about (0.00, 0.00, -1.00), 1.95 ± 0.02 mm a turn, 0.75 Nm",
        "rests": "20.0 N of 25.5 N taught before",
        "load": "0.25 ± 0.01 kg",
        "gripper": "40 mm",
    }
    assert card(1, one)["limited"]


@pytest.mark.parametrize("values", [(-0.0001, 0.0, -0.0), (0.0, 0.0, 0.0)])
def test_zero_has_no_sign(values):
    assert vector(values, "N", 1) == "(0.0, 0.0, 0.0) N"


def test_a_timeline_has_its_version_and_what_a_reader_must_know():
    program = example(Program).model_copy(update={"version": 7, "notes": ("a gap from 1 s to 2 s",)})
    shown = Timeline().of(program)
    assert shown["version"] == 7
    assert shown["notes"] == ["a gap from 1 s to 2 s"]
    assert [one["number"] for one in shown["apps"]] == list(range(1, len(program.apps) + 1))


def test_a_long_program_shows_its_newest_apps_by_their_numbers():
    program = example(Program).model_copy(update={"apps": (app(),) * 250})
    shown = Timeline(listed=100).of(program)
    assert (shown["before"], shown["after"]) == (150, 0)
    assert [one["number"] for one in shown["apps"]] == list(range(151, 251))


@pytest.mark.parametrize(("last", "listed"), [(170, (71, 170)), (30, (1, 100)), (999, (151, 250))])
def test_every_part_of_a_long_program_is_shown_on_request(last, listed):
    program = example(Program).model_copy(update={"apps": (app(),) * 250})
    shown = Timeline(listed=100).of(program, last=last)
    numbers = [one["number"] for one in shown["apps"]]
    assert (numbers[0], numbers[-1]) == listed
    assert (shown["before"], shown["after"]) == (listed[0] - 1, 250 - listed[1])


class ProgramScript:
    """What `program.js` does with a payload."""

    def __init__(self) -> None:
        self.shown: dict = {}

    def apply(self, payload: dict) -> None:
        held, self.shown = self.shown, {**self.shown, **payload}
        for name in ROWS.keys() & payload.keys():
            first, rows = payload[name]["first"], payload[name]["rows"]
            before = self.shown[ROWS[name]]
            kept = [row for row in held.get(name, []) if before < row["number"] < first]
            self.shown[name] = kept + rows


def taught(*targets: float) -> Program:
    """An app after the other, each to a place on x [m]."""
    apps = [
        app(target=(x, 0.0, 0.0), path=None, screw=None, t0=float(i), tn=i + 1.0, segments=(i,))
        for i, x in enumerate(targets)
    ]
    changes = {"apps": tuple(apps), "edits": (), "gaps": (), "version": len(apps), "complete": False}
    return example(Program).model_copy(update=changes)


def test_a_page_that_takes_every_change_has_all_that_is_shown():
    places = [0.01 * i for i in range(30)]
    programs = [
        taught(*places[:10]),
        taught(*places[:11]),
        taught(*places[:10], 0.9),
        taught(*places[:4], 0.8, *places[5:12]),
        taught(*places[:6]),
        taught(*places).model_copy(update={"complete": True}),
        taught(0.7, *places[1:]),
        taught(*places[:3]).model_copy(update={"session": "another"}),
    ]
    made, browser, sent = Timeline(listed=8, drawn=12), ProgramScript(), {}
    for program in programs:
        for last in (None, 9, 3, 25):
            shown = made.of(program, last=last)
            afresh = Timeline(listed=8, drawn=12).of(program, last=last)
            assert shown == afresh, "what was made before is what would be made now"
            browser.apply(changes(sent, shown))
            assert browser.shown == shown
            assert changes(shown, made.of(program, last=last)) == {}
            sent = shown


@pytest.mark.parametrize("count", [20, 90, 400])
def test_one_app_more_is_a_few_rows_however_long_the_program_is(count):
    made, places = Timeline(), [0.001 * i for i in range(count)]
    before = made.of(taught(*places))
    payload = changes(before, made.of(taught(*places, 0.9)))
    assert [len(payload[name]["rows"]) for name in ("apps", "path")] == [2, 1]


def test_notes_have_times_as_people_read_them_and_apps_those_of_the_samples():
    clock = SessionClock(1764172800.25)
    one = app(t0=clock.start_s + 1.0, tn=clock.start_s + 2.0)
    note = f"Not observed: {clock.start_s + 1.5:.2f} s."
    shown = Timeline().of(example(Program).model_copy(update={"apps": (one,), "notes": (note,)}), clock)
    assert shown["start"] == clock.start_s
    assert shown["notes"] == ["Not observed: 1.50 s."]
    assert shown["apps"][0]["t0"] == clock.start_s + 1.0
