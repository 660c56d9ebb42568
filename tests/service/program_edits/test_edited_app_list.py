"""Edits come to the same by index and from memory as by a look at every app and from the first edit on."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from caesura_protocol.app_kinds import app_title
from caesura_protocol.messages import (
    App,
    AppReference,
    ChangeApp,
    DeleteApp,
    DuplicateApp,
    InsertApp,
    MoveApp,
    NameProgram,
    ProgramEdit,
    ReplacePart,
)
from caesura_service.program_edits import edited_app_list_cache
from caesura_service.program_edits.edit_log import EditLog
from caesura_service.program_edits.edited_app import common_share, key_of, keys_meant
from caesura_service.program_edits.edited_app_list import (
    LEAST_COMMON,
    NAMED,
    EditedAppList,
    NotApplicableError,
)
from caesura_service.program_edits.edited_app_list_cache import EditedAppListCache
from caesura_service.program_edits.program_with_edits import at_edit, with_edits
from service.program_edits.edits import PATH, program, ref, taught

AGAIN = (taught()[0], taught()[0], taught()[1])


class PlainDraft(EditedAppList):
    """Looks at every app for every edit."""

    deleted: tuple[tuple[App, ProgramEdit], ...] = ()

    def _find(self, wanted: AppReference) -> int:
        apps = [item.inferred for item in self.items]
        same = [index for index, app in enumerate(apps) if key_of(app) in keys_meant(wanted)]
        scored = [(common_share(wanted, apps[index]), index) for index in same] or [
            (likeness(wanted, app), index) for index, app in enumerate(apps)
        ]
        most, best = max(scored, default=(0.0, 0))
        if not same and most < LEAST_COMMON:
            raise NotApplicableError(self._missing(wanted))
        return best

    def _take_out(self, first: int, stop: int, edit: ProgramEdit) -> None:
        self.deleted += tuple((item.inferred, edit) for item in self.items[first:stop])
        super()._take_out(first, stop, edit)

    def _deletion(self, wanted: AppReference) -> int | None:
        scored = [(likeness(wanted, app), edit.number) for app, edit in self.deleted]
        most, number = max(scored, default=(0.0, 0))
        return number if most >= LEAST_COMMON else None

    def _near(self, wanted: AppReference) -> list[int]:
        apps = {number: self._items[number].inferred for number in self._order}
        return [number for number, app in apps.items() if app.added is None]


def likeness(wanted: AppReference, app: App) -> float:
    if key_of(app) in keys_meant(wanted):
        return 1.0
    is_other = wanted.kind != app.kind or wanted.added is not None or app.added is not None
    return 0.0 if is_other else common_share(wanted, app)


PROGRAM = tuple(
    one.model_copy(update={"t0": t, "tn": t + long_s, "segments": (index,)})
    for index, (one, t, long_s) in enumerate(
        (taught()[index % 3], 0.7 * index, (0.0, 0.2, 0.7, 3.0)[index % 4]) for index in range(12)
    )
)
OFF_S = st.sampled_from([0.0, 0.0, 0.05, -0.1, 0.3, 2.0, -6.0])
REFERENCES = st.one_of(
    st.builds(
        lambda app, early_s, late_s: AppReference(kind=app.kind, t0=app.t0 + early_s, tn=app.tn + late_s),
        st.sampled_from(PROGRAM),
        OFF_S,
        OFF_S,
    ),
    st.builds(
        lambda app, added: AppReference(kind=app.kind, t0=app.t0, tn=app.tn, added=added),
        st.sampled_from(PROGRAM),
        st.integers(1, 9),
    ),
)
ACTIONS = st.one_of(
    st.builds(
        ChangeApp,
        app=REFERENCES,
        name=st.sampled_from([None, "here"]),
        target=st.sampled_from([None, PATH.start.position, (200.0, 0.0, 0.0)]),
        tolerance_m=st.sampled_from([None, 0.003]),
        as_taught=st.sampled_from([(), ("name", "target")]),
    ),
    st.builds(MoveApp, app=REFERENCES, after=st.none() | REFERENCES),
    st.builds(DeleteApp, app=REFERENCES),
    st.builds(DuplicateApp, app=REFERENCES),
    st.builds(
        InsertApp,
        after=st.none() | REFERENCES,
        kind=st.sampled_from(["gripper_move", "cartesian_motion"]),
        seconds=st.just(600.0),
    ),
    st.builds(ReplacePart, first=REFERENCES, last=REFERENCES, session=st.just("other")),
    st.builds(NameProgram, name=st.just("tray")),
)


def made(actions: Sequence[object]) -> tuple[ProgramEdit, ...]:
    again = [AGAIN if isinstance(action, ReplacePart) else () for action in actions]
    return tuple(
        ProgramEdit(number=number, author="Ann", at=1.0, action=action, state="applied", apps=apps)
        for number, (action, apps) in enumerate(zip(actions, again, strict=True), 1)
    )


@settings(max_examples=150, deadline=None, derandomize=True)
@given(st.lists(ACTIONS, max_size=14))
def test_an_index_finds_the_apps_that_a_look_at_every_app_finds(actions):
    drafts = [kind(PROGRAM, 20.0) for kind in (EditedAppList, PlainDraft)]
    for draft in drafts:
        for edit in made(actions):
            draft.apply(edit)
    quick, plain = ((draft.known, [item.app for item in draft.items], draft.name) for draft in drafts)
    assert repr(quick) == repr(plain)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.lists(ACTIONS, max_size=20), st.data())
def test_from_memory_edits_come_to_the_same_as_from_the_first_on(actions, data):
    """After undo, other edits in their place, refusals, and at older versions."""
    inferred, drafts, edits = program(PROGRAM), EditedAppListCache(), made(actions)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(edited_app_list_cache, "STEP", 3)
        for _ in range(6):
            kept = data.draw(st.integers(0, len(edits)))
            others = data.draw(st.integers(0, 2))
            some = (*edits[:kept], *made(actions)[kept : kept + others])
            log = EditLog(some, (), len(some))
            assert repr(with_edits(inferred, log, drafts)) == repr(with_edits(inferred, log))
            version = data.draw(st.integers(0, len(some)))
            assert repr(at_edit(inferred, log, version, drafts)) == repr(at_edit(inferred, log, version))


def test_one_edit_more_costs_one_edit_and_an_older_version_a_step(monkeypatch):
    applied: list[int] = []
    apply = EditedAppList.apply
    monkeypatch.setattr(
        EditedAppList, "apply", lambda self, edit: applied.append(edit.number) or apply(self, edit)
    )
    edits = made([ChangeApp(app=ref(PROGRAM[0]), name=f"n{number}") for number in range(200)])
    drafts, inferred = EditedAppListCache(), program(PROGRAM)
    with_edits(inferred, EditLog(edits[:199], (), 199), drafts)
    assert len(applied) == 199
    for _ in range(3):  # one is refused, as another one is
        with_edits(inferred, EditLog((*edits[:199], *made([NameProgram(name="x")])), (), 200), drafts)
    with_edits(inferred, EditLog(edits, (), 200), drafts)
    assert len(applied) == 199 + 4
    for number in (198, 130, 64, 0):
        at_edit(inferred, EditLog(edits, (), 200), number, drafts)
    assert len(applied) <= 203 + 4 * edited_app_list_cache.STEP
    assert applied[203:] == [*range(193, 199), 129, 130]


def test_a_reason_names_the_first_apps_in_the_order_of_the_program():
    last, wide = PROGRAM[-1], AppReference(kind="hold", t0=-1.0, tn=9.0)
    draft = EditedAppList(PROGRAM)
    for edit in made([MoveApp(app=ref(last), after=None), DeleteApp(app=wide)]):
        draft.apply(edit)
    reason = str(draft.known[-1].reason)
    assert f"now there is '{app_title(last.kind)}' at {last.t0:.2f}" in reason
    assert reason.endswith(f" and {len(PROGRAM) - NAMED} more")
