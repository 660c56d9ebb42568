"""Corrections and their effects in words."""

from __future__ import annotations

from typing import Any

import pytest

from caesura_clients.cli.edit import _print_corrections
from caesura_clients.correction_words import (
    ELSEWHERE,
    NOTHING_CHANGES,
    changepoint_made,
    changepoint_meant,
    described,
    effect_words,
    in_words,
    relabel_doubt,
    transport_doubt,
)
from caesura_protocol.messages import (
    Action,
    AppOutline,
    Correction,
    EditEffect,
    Insert,
    LimitForce,
    Move,
    NamePhase,
    PhaseOutline,
    Redo,
    Relabel,
    Remove,
    SegmentOutline,
    TakeBack,
    Undo,
)
from caesura_protocol.session_time_display import SessionClock
from clients.examples import snapshot


@pytest.mark.parametrize(
    ("action", "words"),
    [
        (Insert(t=3.2), "inserted a changepoint at 3.20 s"),
        (Remove(t=3.2), "removed the changepoint at 3.20 s"),
        (Move(t=3.2, to=4.0), "moved the changepoint at 3.20 s to 4.00 s"),
        (Relabel(t=3.2, kind="hold"), "named the segment at 3.20 s hold"),
        (LimitForce(t=3.2, newton=8.5), "limited the force at 3.20 s to 8.5 N"),
        (LimitForce(t=3.2, newton=None), "lifted the limit of the force at 3.20 s"),
        (NamePhase(t=3.2, name="wipe {t}"), "named the phase at 3.20 s 'wipe {t}'"),
        (TakeBack(number=2), "took correction 2 back"),
        (Undo(), "took the last correction back"),
        (Redo(), "made the correction that was taken back last once more"),
    ],
)
def test_every_correction_has_words(action: Action, words: str):
    assert in_words(action) == words


@pytest.mark.parametrize(
    ("kind", "load_kg", "load_sd_kg", "words"),
    [
        ("transport", 0.0, 0.012, "Its load is 0.00 ± 0.01 kg: is something carried there?"),
        (
            "transport",
            -0.0002,
            0.012,
            "Its load is 0.00 ± 0.01 kg: is something carried there?",
        ),
        (
            "transport",
            0.023,
            0.012,
            "Its load is 0.02 ± 0.01 kg: is something carried there?",
        ),
        ("transport", 0.025, 0.012, ""),
        ("transport", None, None, ""),
        ("hold", 0.0, 0.012, ""),
    ],
)
def test_a_transport_without_a_load_is_doubted(kind, load_kg, load_sd_kg, words):
    (segment,) = snapshot(1, "motion").segments.segments[:1]
    made = segment.model_copy(update={"kind": kind, "load_kg": load_kg, "load_sd_kg": load_sd_kg})
    assert transport_doubt(made) == words


def test_a_doubt_states_the_load_of_the_app_as_the_page_does():
    """Of a relabelled segment it was 0±118 g, and of its app 0.14±0.06 kg."""
    part = SegmentOutline(t0=2.0, tn=3.0, kind="transport", load_kg=0.0, load_sd_kg=0.118)
    carries = app("transport", load_kg=0.14, load_sd_kg=0.06)
    assert relabel_doubt(Relabel(t=2.5, kind="transport"), effect(segments_after=(part,))) == (
        "Its load is 0.00 ± 0.12 kg: is something carried there?"
    )
    both = effect(segments_after=(part,), apps_after=(carries,))
    assert relabel_doubt(Relabel(t=2.5, kind="transport"), both) == ""
    unsure = both.model_copy(update={"apps_after": (app("transport", load_kg=0.04, load_sd_kg=0.06),)})
    assert relabel_doubt(Relabel(t=2.5, kind="transport"), unsure) == (
        "Its load is 0.04 ± 0.06 kg: is something carried there?"
    )


def test_times_are_those_of_the_clock_that_people_read():
    clock = SessionClock(1_700_000_000.0)
    made = Correction(number=1, author="Ann", at=0.0, action=Move(t=1_700_000_003.2, to=1_700_000_004.0))
    assert described(made, clock) == "Ann moved the changepoint at 3.20 s to 4.00 s"


def outlines(*kinds: str) -> tuple[SegmentOutline, ...]:
    return tuple(SegmentOutline(t0=i, tn=i + 1, kind=kind) for i, kind in enumerate(kinds))


def app(kind: Any = "apply_force", **values: Any) -> AppOutline:
    return AppOutline(kind=kind, **({"t0": 2.0, "tn": 3.5} | values))


def effect(**rows: Any) -> EditEffect:
    return EditEffect(first_segment=0, first_app=4, **rows)


def test_an_app_is_called_by_its_name():
    named = app(name="press the seal", force=(0.0, 0.0, -8.0))
    limited = app(name="press the seal", force=(0.0, 0.0, -4.0))
    assert effect_words(effect(apps_before=(named,), apps_after=(limited,))) == [
        "App 5 (press the seal): force 8.0 N becomes 4.0 N."
    ]


def test_segments_become_others_of_which_a_few_are_named():
    found = effect(segments_before=outlines("motion", "hold"), segments_after=outlines("hold"))
    assert effect_words(found) == [
        "Motion 0.00 to 1.00 s and hold 1.00 to 2.00 s become hold 0.00 to 1.00 s."
    ]
    many = effect(segments_before=outlines("hold"), segments_after=outlines(*["motion"] * 9), more=3)
    assert effect_words(many) == [
        "Hold 0.00 to 1.00 s becomes motion 0.00 to 1.00 s, motion 1.00 to 2.00 s, "
        "motion 2.00 to 3.00 s and 6 more.",
        "3 segments, apps and phases are not listed.",
    ]


def test_results_of_another_version_that_an_edit_infers_again_are_named_with_the_reason():
    found = effect(segments_after=outlines("hold"), inferred_again=True)
    assert effect_words(found) == ["Hold 0.00 to 1.00 s is added.", ELSEWHERE]
    assert effect_words(effect(inferred_again=True)) == [NOTHING_CHANGES, ELSEWHERE]


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ((), (app(),), "App 5 (apply force) is added."),
        ((app(), app("grasp")), (), "App 5 (apply force) and app 6 (grasp) are left out."),
        ((app("grasp"),), (app("hold"),), "App 5 (grasp) becomes app 5 (hold)."),
        (
            (app(force=(0.0, 3.0, 4.0)),),
            (app(force=(0.0, 0.0, 2.0)),),
            "App 5 (apply force): force 5.0 N becomes 2.0 N.",
        ),
        (
            (app(target=(0, 0, 0)),),
            (app(target=(0.01, 0, 0)),),
            "App 5 (apply force): target moves by 10.0 mm.",
        ),
        ((app(load_kg=None),), (app(load_kg=0.25),), "App 5 (apply force): load 0.00 kg becomes 0.25 kg."),
        (
            (app(gripper_width=0.04),),
            (app(gripper_width=0.01, tn=4.0),),
            "App 5 (apply force): 2.00 to 3.50 s becomes 2.00 to 4.00 s, gripper width 40 mm becomes 10 mm.",
        ),
        ((app(force=(0, 0, 1.0)),), (app(force=(0, 0, 1.001)),), "Nothing changes."),
    ],
)
def test_apps_state_what_of_them_changes_as_people_read_it(before, after, words: str):
    assert effect_words(effect(apps_before=before, apps_after=after)) == [words]


def test_phases_are_stated_where_kinds_or_names_differ():
    free, named = (PhaseOutline(t0=0.0, tn=2.0, kind="free", name=name) for name in (None, "reach"))
    assert effect_words(effect(phases_before=(free,), phases_after=(named,))) == [
        "Phase free 0.00 to 2.00 s becomes phase reach (free) 0.00 to 2.00 s."
    ]
    longer = free.model_copy(update={"tn": 3.0})
    assert effect_words(effect(phases_before=(free,), phases_after=(longer,))) == ["Nothing changes."]


def test_of_many_apps_with_other_values_three_are_named():
    before, after = (tuple(app(load_kg=load) for _ in range(5)) for load in (0.1, 0.2))
    *named, rest = effect_words(effect(apps_before=before, apps_after=after))
    assert len(named) == 3
    assert rest == "Values of 2 more apps change."


def test_a_changepoint_is_named_where_it_was():
    found = effect(segments_before=outlines("motion", "hold", "motion"), segments_after=outlines("hold"))
    assert changepoint_meant(Remove(t=1.3), found) == 1.0
    assert changepoint_meant(Move(t=1.8, to=1.5), found) == 2.0
    assert changepoint_meant(Remove(t=1.3), effect()) == 1.3


def test_a_changepoint_is_named_where_it_is_made():
    found = effect(segments_before=outlines("motion"), segments_after=outlines("motion", "hold", "motion"))
    assert changepoint_made(Insert(t=1.1), found) == 1.0
    assert changepoint_made(Move(t=0.4, to=1.9), found) == 2.0
    assert changepoint_made(Insert(t=1.1), effect()) == 1.1, "there is one"


def test_a_session_whose_corrections_are_not_listed_is_not_called_uncorrected(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    """As one that an older version of the service closed."""
    monkeypatch.setenv("COLUMNS", "120")
    whole = snapshot(0, "motion", corrections=())
    _print_corrections(whole.model_copy(update={"status": whole.status.model_copy(update={"revision": 2})}))
    assert "revision 2: its corrections, made under an older version" in capsys.readouterr().out
    _print_corrections(whole.model_copy(update={"status": whole.status.model_copy(update={"revision": 0})}))
    assert "no corrections" in capsys.readouterr().out
