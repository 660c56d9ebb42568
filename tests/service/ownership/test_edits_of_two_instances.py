"""Edits where two instances serve a station in turn: none that was acknowledged is lost."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import (
    Ack,
    EditProgram,
    Insert,
    NameProgram,
    Redo,
    SessionStatus,
    TakeBack,
    Undo,
)
from caesura_service.journal import AppliedEdit, Record
from caesura_service.publishing.events import TakeoverFailed
from caesura_service.publishing.session_state import program_of, status_of
from caesura_service.segmentation.corrections import EditHistory, ResolvedEdit
from caesura_service.server.inbound_events import LivelinessChanged, Watching
from caesura_service.server.live_tokens import LiveTokens
from caesura_service.server.station_manager import StationManager
from harness.sessions import (
    NAME,
    STATION,
    answer,
    closing,
    opening,
    published,
)
from service.ownership.test_takeover import COUNT, RestartableRegistry, has_checked
from service.sessions.edits import T, compared, edit, refused, stepped


@pytest.fixture
def pair(tmp_path: Path) -> Iterator[tuple[RestartableRegistry, RestartableRegistry]]:
    with ExitStack() as stack:
        yield RestartableRegistry(tmp_path, "a", stack), RestartableRegistry(tmp_path, "b", stack)


def corrected(instance: RestartableRegistry, revision: int = 0, action: Any = None) -> Ack | ProtocolError:
    return answer(instance.registry.handle_command(STATION, edit(revision, action), 9.0))


def named(instance: RestartableRegistry, revision: int) -> Ack | ProtocolError:
    action = NameProgram(name=f"version {revision}")
    command = EditProgram(session=NAME, revision=revision, author="Ann", action=action)
    return answer(instance.registry.handle_command(STATION, command, 9.0))


def test_an_instance_that_takes_a_station_over_has_its_corrections(pair):
    a, b = pair
    a.open()
    a.feed(*range(9))
    assert corrected(a).revision == 1
    a.kill()
    b.take()
    assert (b.standing.revision, b.standing.program_header.author) == (1, "Ann")
    b.feed(*range(9, COUNT))
    b.close()
    assert corrected(b, 1, Insert(t=0.5)).revision == 2
    a.take()
    assert compared(a.standing) == compared(b.standing)


def test_an_edit_that_reaches_an_owner_behind_its_successor_takes_no_acknowledged_one_away(pair):
    """An instance was frozen on the way: its successor had acknowledged another edit at that revision."""
    a, b = pair
    a.open()
    a.feed(*range(9))
    a.journal.commit()
    b.take()
    assert corrected(b, 0, Insert(t=0.5)).revision == 1
    late = refused(corrected(a))
    assert (late.code, a.standing.revision) == ("overloaded", 0)
    assert "another instance has served the station" in late.message
    a.take(renew=False)
    assert compared(a.standing) == compared(b.standing)
    assert corrected(a, 1).revision == 2


@pytest.mark.parametrize("command", [closing(8), opening("s2")], ids=["close", "open"])
def test_a_command_that_reaches_an_owner_behind_its_successor_is_no_refusal_of_its_session(pair, command):
    """The bridge asks again; the operator would read of a fault where there is none."""
    a, b = pair
    a.open()
    a.feed(*range(9))
    a.journal.commit()
    b.take()
    outputs = a.registry.handle_command(STATION, command, 9.0)
    assert refused(answer(outputs)).code == "overloaded"
    assert published(outputs, SessionStatus) == []
    a.take(renew=False)
    assert status_of(a.standing).refused == {}


def test_an_edit_that_is_acknowledged_while_another_instance_acquires_the_station_is_taken_along(pair):
    """That one had read the journals before, and the next edit took the place of the acknowledged one."""
    a, b = pair
    a.open()
    a.feed(*range(9))
    a.registry.release(STATION)
    b.take()
    b.registry.release(STATION)
    a.take()
    store = b.journal.store_epoch

    def storing(station: str, epoch: int) -> None:
        assert isinstance(corrected(a, 0, Insert(t=0.5)), Ack)
        store(station, epoch)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(b.journal, "store_epoch", storing)
        b.take()
    assert b.standing.revision == 1


@pytest.mark.parametrize("change", [corrected, named])
def test_an_edit_is_not_acknowledged_where_another_instance_acquires_the_station_meanwhile(pair, change):
    """Between the check of the epoch and the record; that one did not have the edit, and took another."""
    a, b = pair
    a.open()
    a.feed(*range(9))
    a.registry.release(STATION)
    b.take()
    b.registry.release(STATION)
    a.take()
    append = a.journal.append

    def appending(record: Record, *, now: bool = False) -> None:
        b.take()
        append(record, now=now)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(a.journal, "append", appending)
        assert refused(change(a, 0)).code == "overloaded"
    assert b.take(renew=False)  # as the poll does
    assert isinstance(change(b, 0), Ack)  # asked again


def test_an_owner_that_was_frozen_shows_nothing_before_it_has_the_corrections_of_its_successor(pair):
    """A reader had a revision lower than an acknowledged one while the takeover lasted, some seconds."""
    a, b = pair
    a.open()
    a.feed(*range(9))
    a.journal.commit()
    b.take()
    assert corrected(b, 0, Insert(t=0.5)).revision == 1
    ownership = a.registry.ownership
    assert not ownership.may_be_behind({STATION})  # as far as it can know
    ownership.is_unlinked = True
    assert ownership.may_be_behind({STATION})
    ownership.begin_takeover(STATION)
    ownership.is_unlinked = False
    shown = []
    for _ in a.registry.take_over(STATION, 0.0):
        shown.append((bool(ownership.may_be_behind({STATION})), a.standing.revision))
    assert shown[0] == (True, 0)
    assert shown[-1] == (False, 1)


def test_an_instance_that_starts_shows_nothing_that_its_predecessor_has_taken_back_and_changed(pair):
    """The last owner learns of it after it has read the journals. It answered with the older revision."""
    starting, last = pair  # the station is a's where both are there
    last.open()
    last.feed(*range(9))
    last.journal.commit()
    now = [0.0]
    manager = StationManager(starting.registry, "a", lambda _: None, lambda: now[0])
    manager.start(LiveTokens(frozenset({"b"}), frozenset({STATION})))
    ownership = starting.registry.ownership
    assert not ownership.may_be_behind({STATION})
    last.take()
    assert corrected(last, 0, Insert(t=0.5)).revision == 1
    for event in (LivelinessChanged("station", STATION, True), Watching()):
        assert ownership.may_be_behind({STATION})
        manager.handle_event(event)
    while ownership.is_settling:
        assert ownership.may_be_behind({STATION}) or starting.standing.revision == 1
        now[0] += manager.idle_s()
        manager.step()
    assert starting.standing.revision == 1
    assert ownership.serves(STATION)
    assert now[0] < 4.0


def test_an_instance_that_is_alone_settles_at_its_start(pair):
    a, _ = pair
    manager = StationManager(a.registry, "a", lambda _: None, lambda: 0.0)
    manager.start(LiveTokens(frozenset(), frozenset({STATION})))
    assert a.registry.ownership.is_settling
    manager.handle_event(Watching())
    assert not a.registry.ownership.is_settling


def test_a_station_without_another_owner_is_shown_while_it_is_taken_over_again(pair):
    a, _ = pair
    a.open()
    a.feed(*range(9))
    for _ in a.registry.take_over(STATION, 0.0):
        assert not a.registry.ownership.may_be_behind({STATION})


def test_an_edit_of_the_program_behind_a_successor_takes_no_acknowledged_one_away(pair):
    a, b = pair
    a.open()
    a.feed(*range(9))
    b.take()
    assert isinstance(named(b, 0), Ack)
    assert refused(named(a, 0)).code == "overloaded"
    a.take()
    assert program_of(a.standing).name == "version 0"
    assert isinstance(named(a, 1), Ack)


def test_an_edit_of_a_session_that_only_another_instance_has_is_kept_here_with_all_of_it(pair):
    a, b = pair
    a.open()
    a.feed(*range(COUNT))
    a.close()
    a.registry.release(STATION)
    b.take()
    assert refused(corrected(b)).code == "overloaded"
    stepped(b.registry)
    assert corrected(b).revision == 1
    a.path.unlink()
    b.kill()
    b.take()
    assert (b.standing.revision, b.standing.lifecycle) == (1, "closed")
    assert T in [one.t for one in b.standing.view.changepoints]


def test_an_undo_of_a_closed_session_is_acknowledged_again_by_another_instance_and_made_once(pair):
    """Only the records have whose undo it was, and b has none before it rebuilds the session."""
    a, b = pair
    a.open()
    a.feed(*range(COUNT))
    a.close()
    acks = [corrected(a, 0), corrected(a, 1, Insert(t=0.525)), corrected(a, 2, Undo())]
    a.kill()
    b.take()
    assert refused(corrected(b, 2, Undo())).code == "overloaded"
    stepped(b.registry)
    assert (corrected(b, 2, Undo()), b.standing.revision) == (acks[-1], 3)
    other = refused(answer(b.registry.handle_command(STATION, edit(2, Undo(), author="Bo"), 9.0)))
    assert (other.code, other.limit) == ("conflict", 3)


@pytest.mark.parametrize("cancelled_after", [None, *range(COUNT, COUNT + 5)])
def test_an_edit_of_the_program_waits_until_all_that_a_peer_recorded_is_copied(
    pair, cancelled_after: int | None
):
    """The close is copied before the edits: one more, in between, once took the place of the rest."""
    a, b = pair
    a.open()
    a.feed(*range(COUNT))
    a.close()
    for revision in range(4):
        assert named(a, revision).revision == 0
    a.registry.release(STATION)
    b.take()
    steps = 0
    while isinstance(replied := named(b, 4), ProtocolError):
        assert replied.code == "overloaded"
        b.registry.rebuild_step(STATION)
        if steps == cancelled_after:
            b.registry.release(STATION)
            b.take()
        steps += 1
    a.path.unlink()
    b.kill()
    b.take()
    assert [one.number for one in program_of(b.standing).edits] == [1, 2, 3, 4, 5]
    assert program_of(b.standing).name == "version 4"


def test_an_edit_of_a_closed_session_elsewhere_is_found_when_one_looks_again(pair, monkeypatch):
    a, b = pair
    has_checked(a, monkeypatch)
    a.open()
    a.feed(*range(COUNT))
    a.close()
    b.take()
    stepped_back = b.standing
    assert corrected(a).revision == 1
    said = b.take(renew=False)
    assert [status.revision for status in published(said, SessionStatus)] == [1]
    assert stepped_back.revision == 0
    assert compared(b.standing) == compared(a.standing)


def test_an_edit_of_an_open_session_elsewhere_is_found_when_one_looks_again(pair, monkeypatch):
    a, b = pair
    has_checked(a, monkeypatch)
    a.open()
    a.feed(*range(9))
    a.journal.commit()
    b.take()
    assert corrected(a).revision == 1
    b.take(renew=False)
    assert b.standing.revision == 1
    b.feed(*range(9, COUNT))
    a.registry.release(STATION)
    b.close()
    assert T in [one.t for one in b.standing.view.changepoints]


def test_a_reader_that_looks_again_and_again_has_each_edit_once(pair, monkeypatch):
    a, b = pair
    has_checked(a, monkeypatch)
    a.open()
    a.feed(*range(9))
    a.journal.commit()
    b.take()
    for revision, t in enumerate((0.155, 0.525, 1.155)):
        assert corrected(a, revision, Insert(t=t)).revision == revision + 1
        b.take(renew=False)
        assert b.standing.revision == revision + 1
    b.kill()
    b.take()
    assert b.standing.revision == 3
    assert sum(isinstance(one.message, AppliedEdit) for one in b.journal.replay(STATION, NAME)) == 3


# What may happen: a batch, an edit, a close, the station changes hands, an instance is killed or hangs.
steps = st.lists(
    st.one_of(
        st.integers(0, COUNT - 1),
        st.sampled_from(
            [Insert(t=0.155), Insert(t=0.525), Insert(t=1.155), Undo(), Redo(), TakeBack(number=1)]
        ),
        st.sampled_from(["commit", "hand", "kill", "freeze", "look", "close"]),
    ),
    max_size=30,
)


def edited(instance: RestartableRegistry, action: Any) -> bool:
    """Was it acknowledged, and once more where it is asked for again?

    A session that is known by its outcome is rebuilt first.
    """
    revision = instance.standing.revision
    reply = corrected(instance, revision, action)
    if isinstance(reply, ProtocolError) and reply.code == "overloaded":
        assert not [said for said in stepped(instance.registry) if isinstance(said, TakeoverFailed)]
        reply = corrected(instance, revision, action)
    if not isinstance(reply, Ack):
        return False
    assert corrected(instance, revision, action) == reply.model_copy(update={"effect": None})
    return True


@settings(deadline=None, max_examples=50)
@given(steps)
def test_whatever_happens_between_two_instances_no_acknowledged_edit_is_lost(steps: list[Any]):
    with tempfile.TemporaryDirectory() as directory, ExitStack() as stack:
        owner, other = (RestartableRegistry(Path(directory), name, stack) for name in "ab")
        owner.open()
        model, expected = EditHistory(), 0
        for step in steps:
            match step:
                case int():
                    owner.feed(step)
                case "commit":
                    owner.journal.commit()
                case "look":
                    owner.take(renew=False)
                case "close":
                    close = closing(owner.next_seq - 1)
                    owner.registry.handle_command(STATION, close, 0.0)
                case str():
                    if step == "hand":
                        owner.registry.release(STATION)
                    elif step == "kill":
                        owner.kill()
                    owner, other = other, owner
                    owner.take()
                case action if edited(owner, action):
                    model = model.after(
                        edit(action=action), 0.0, lambda change: ResolvedEdit(inserted=change.t)
                    )
                    expected += 1
            assert owner.standing.revision == expected
            shown = {one.t for one in owner.standing.view.changepoints}
            assert {one.inserted for one in model.active} == shown & {0.155, 0.525, 1.155}
