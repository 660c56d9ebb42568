"""The mutations: what each breaks, where, and the tests that must catch it."""

from __future__ import annotations

from typing import NamedTuple

SESSIONS = "service/caesura_service/sessions"
SEGMENTATION = "service/caesura_service/segmentation"
JOURNAL = "service/caesura_service/journal"
SERVER = "service/caesura_service/server"


class Mutation(NamedTuple):
    """One text of one file, replaced by another; `tests` are pytest's names of the fewest that must fail."""

    name: str
    file: str
    text: str  # which the file has exactly once
    replacement: str
    tests: tuple[str, ...]
    row: str = ""  # of `make faults`, where one catches it too


MUTATIONS: tuple[Mutation, ...] = (
    Mutation(
        "a batch is not journalled",
        f"{SESSIONS}/batch_receiver.py",
        "        self._journal.append(batch, now)\n        samples, outputs = self._validated(batch)\n",
        "        samples, outputs = self._validated(batch)\n",
        ("tests/service/sessions/test_disturbances.py::test_a_rebuilt_session_goes_on_like_the_original",),
        row="histories",
    ),
    Mutation(
        "batches that are processed together are not journalled",
        f"{SESSIONS}/batch_receiver.py",
        "        count = self._journal.append_batches(block, count, now)\n        is_in_turn",
        "        is_in_turn",
        (
            "tests/service/server/test_batch_collector.py::"
            "test_a_demonstration_in_batches_that_wait_is_bit_for_bit_the_same",
        ),
    ),
    Mutation(
        "batches that are processed together are cut elsewhere",
        f"{SESSIONS}/batch_receiver.py",
        "until = int(is_due.argmax()) if is_due.any() else len(samples) - 1",
        "until = len(samples) - 1",
        (
            "tests/service/server/test_batch_collector.py::"
            "test_a_wrong_guess_when_an_observation_is_complete_changes_nothing",
        ),
    ),
    Mutation(
        "a batch that came early is not journalled",
        f"{SESSIONS}/batch_receiver.py",
        "        self._journal.append(batch, now)\n        return [*self._hold(batch)",
        "        return [*self._hold(batch)",
        (
            "tests/service/sessions/test_disturbances.py::test_a_session_rebuilt_from_its_journal_equals_the_original",
        ),
    ),
    Mutation(
        "acknowledged before written",
        f"{SESSIONS}/session.py",
        "        self._journal.commit()\n        return Reply(self._acknowledgement(",
        "        return Reply(self._acknowledgement(",
        ("tests/service/journal/test_sqlite_journal.py::test_an_acknowledgement_is_given_for_what_is_safe",),
    ),
    Mutation(
        "an edit is processed before it is written",
        f"{SESSIONS}/session_journal.py",
        "now=not is_batch)",
        "now=False)",
        ("tests/service/journal/test_journal.py::test_what_cannot_be_sent_again_is_written_at_once",),
    ),
    Mutation(
        "synchronous is off",
        f"{JOURNAL}/sqlite_database.py",
        '"synchronous = FULL"',
        '"synchronous = OFF"',
        ("tests/service/journal/test_power.py::test_nothing_acknowledged_is_forgotten_by_a_power_loss",),
    ),
    Mutation(
        "an older bridge epoch is accepted",
        f"{SESSIONS}/session.py",
        "        if epoch < current:\n",
        "        if epoch < current < 0:\n",
        ("tests/service/sessions/test_bridge_epochs.py::test_an_older_epoch_is_a_conflict",),
    ),
    Mutation(
        "a gap is not declared",
        f"{SESSIONS}/batch_receiver.py",
        "return [*self._host.declare_gap(given_up), *self._process_ready()]",
        "return self._process_ready()",
        (
            "tests/service/sessions/test_session.py::"
            "test_what_the_ring_no_longer_has_becomes_a_gap_and_the_session_goes_on",
        ),
    ),
    Mutation(
        "a gap has no place among the samples",
        f"{SESSIONS}/pipeline_runner.py",
        "            self._pipeline.declare_gap()\n",
        "",
        (
            "tests/service/sessions/test_session.py::"
            "test_what_the_ring_no_longer_has_becomes_a_gap_and_the_session_goes_on",
        ),
    ),
    Mutation(
        "a replay is asked for twice",
        f"{SESSIONS}/reorder_buffer.py",
        "        self._not_before = now + self._limits.replay_timeout_s\n",
        "",
        ("tests/service/sessions/test_session.py::test_a_hole_is_asked_for_once_and_filled_in_order",),
    ),
    Mutation(
        "a replayed batch is applied twice",
        f"{SESSIONS}/batch_receiver.py",
        "            ready = self._pop_together()\n",
        "            ready = self._pop_together()\n"
        "            if ready:\n"
        "                outputs += self._host.push_together(np.concatenate(ready), len(ready))\n",
        (
            "tests/service/sessions/test_disturbances.py::"
            "test_duplication_reordering_and_loss_with_replay_change_no_result",
        ),
    ),
    Mutation(
        "a batch that comes twice is applied twice",
        f"{SESSIONS}/reorder_buffer.py",
        "        return seq < self.next_seq or seq in self._held\n",
        "        self.next_seq = min(self.next_seq, seq)\n        return False\n",
        ("tests/service/sessions/test_session.py::test_a_batch_that_comes_twice_is_counted_and_ignored",),
    ),
    Mutation(
        "a checksum is ignored",
        f"{JOURNAL}/checksums.py",
        "return crc is None or crc == checksum(*values)",
        "return True",
        (
            "tests/service/journal/test_damaged_file.py::"
            "test_a_damaged_record_costs_its_session_alone_whose_name_is_free_then",
        ),
    ),
    Mutation(
        "the budget of a station is ignored",
        "protocol/caesura_protocol/token_bucket.py",
        "return min(self._filled(bucket, self._clock())) <= 0.0",
        "return False",
        (
            "tests/service/server/test_fairness.py::test_a_station_that_has_used_up_its_work_is_refused_with_the_reason_and_another_goes_on",
        ),
    ),
    Mutation(
        "what a station used is not charged",
        f"{SERVER}/worker.py",
        "        self._budgets.charge_work(lane, took_s)\n",
        "",
        (
            "tests/service/server/test_fairness.py::test_a_station_that_has_used_up_its_work_is_refused_with_the_reason_and_another_goes_on",
        ),
    ),
    Mutation(
        "an edit that is sent again is applied twice",
        f"{SESSIONS}/session.py",
        "        if edit.revision != self.revision:\n",
        "        if edit.revision > self.revision:\n",
        (
            "tests/service/sessions/test_edits.py::test_of_two_editors_the_slower_one_is_refused_with_the_revision_that_there_is",
        ),
    ),
    Mutation(
        "an edit is applied twice at a takeover",
        f"{SESSIONS}/session.py",
        "            case AppliedEdit() as edit if edit.revision == self.revision:\n",
        "            case AppliedEdit() as edit:\n",
        (
            "tests/service/ownership/test_edits_of_two_instances.py::test_a_reader_that_looks_again_and_again_has_each_edit_once",
        ),
    ),
    Mutation(
        "a session is closed before its last batch",
        f"{SESSIONS}/session.py",
        "        if close.last_seq > reached:\n            return self._request_rest(close, now)\n",
        "",
        (
            "tests/service/sessions/test_session.py::"
            "test_closing_before_everything_is_there_asks_for_the_rest_and_is_no_refusal",
        ),
    ),
    Mutation(
        "an edit is not journalled",
        f"{SESSIONS}/session.py",
        "prepared.outcome.corrections, effect, moved)\n        self._journal.append(record, now)\n",
        "prepared.outcome.corrections, effect, moved)\n",
        (
            "tests/service/sessions/test_edit_replay.py::test_a_restart_filters_no_observation_twice_however_many_edits_there_are",
        ),
        row="histories",
    ),
    Mutation(
        "an edit is lost at a restart",
        f"{SESSIONS}/session.py",
        "    self._host.replay_edit(edit, record.at)\n                    case EditProgram()",
        "    pass\n                    case EditProgram()",
        (
            "tests/service/sessions/test_edit_replay.py::test_a_restart_filters_no_observation_twice_however_many_edits_there_are",
        ),
        row="histories",
    ),
    Mutation(
        "an undo takes no revision",
        f"{SEGMENTATION}/corrections.py",
        "active, undone, number = self.active, self.undone, self.revision + 1\n",
        "active, undone, number = self.active, self.undone, self.revision + (edit.action.do != 'undo')\n",
        ("tests/service/sessions/test_edits.py::test_undo_and_redo_are_edits_too",),
        row="histories",
    ),
    Mutation(
        "an older correction is taken back although a later one refers to it",
        f"{SEGMENTATION}/corrections.py",
        "        return index in self.none or index in self.starts\n",
        "        return index in self.starts\n",
        (
            "tests/service/segmentation/test_undone_corrections.py::"
            "test_a_correction_to_whose_changepoint_a_later_one_refers_stays",
        ),
    ),
    Mutation(
        "a correction that is made once more comes last",
        f"{SEGMENTATION}/corrections.py",
        "                again = sorted((*active, undone[-1]), key=lambda one: one.number)\n",
        "                again = (*active, undone[-1])\n",
        (
            "tests/service/segmentation/test_undone_corrections.py::"
            "test_any_correction_is_taken_back_and_redo_puts_it_at_its_place_again",
        ),
        row="histories",
    ),
    Mutation(
        "a preview decides when the next results are published",
        f"{SESSIONS}/pipeline_runner.py",
        "        present, action = copy(self._pipeline), asked.action\n",
        "        present, action = self._pipeline, asked.action\n",
        (
            "tests/service/sessions/test_previews.py::"
            "test_a_preview_is_neither_recorded_nor_published_and_changes_no_later_result",
        ),
    ),
    Mutation(
        "what waits takes the room of deletions",
        f"{JOURNAL}/writer_thread.py",
        "for_deletions = self._makes_room and",
        "for_deletions = False and",
        (
            "tests/service/journal/test_reserve.py::"
            "test_what_another_process_deletes_on_a_disk_without_a_byte_makes_room",
        ),
    ),
    Mutation(
        "an arc about a far centre is a turn in place",
        f"{SEGMENTATION}/turn_in_place_check.py",
        " or path > TOOL_M * angle",
        "",
        (
            "tests/service/segmentation/test_turn_in_place_check.py::test_what_a_rotation_does_not_explain_is_a_movement",
        ),
    ),
    Mutation(
        "a centre that goes along the axis is in place",
        f"{SEGMENTATION}/turn_in_place_check.py",
        "    return float((sway**2).sum()) <= share *",
        "    return 0.0 * float((sway**2).sum()) <= share *",
        (
            "tests/service/segmentation/test_turn_in_place_check.py::test_what_a_rotation_does_not_explain_is_a_movement",
        ),
    ),
    Mutation(
        "an owner that was replaced records corrections",
        "service/caesura_service/ownership/station_ownership.py",
        "        if is_late or self._superseded_among({station}):\n",
        "        if is_late:\n",
        (
            "tests/service/ownership/test_edits_of_two_instances.py::test_an_edit_that_reaches_an_owner_behind_its_successor_takes_no_acknowledged_one_away",
        ),
    ),
    Mutation(
        "a station is served without what could not be copied",
        "service/caesura_service/ownership/registry.py",
        "            self.ownership.fall_behind(station, str(error))\n            raise\n",
        "            raise\n",
        (
            "tests/service/ownership/test_takeover_on_a_full_disk.py::test_a_correction_that_cannot_be_copied_is_not_replaced_by_the_next_one",
        ),
    ),
    Mutation(
        "a session opens before the last one of an instance whose clock was ahead",
        "service/caesura_service/ownership/registry.py",
        "max(now, max(others, own) + STEP_S)",
        "now",
        (
            "tests/service/ownership/test_takeover.py::test_the_last_session_of_a_station_is_the_current_one_whatever_the_clocks_said",
        ),
    ),
    Mutation(
        "an instance that was frozen shows what it had before",
        "service/caesura_service/ownership/registry.py",
        "            self.ownership.begin_catching_up(station)\n",
        "",
        (
            "tests/service/ownership/test_edits_of_two_instances.py::test_an_owner_that_was_frozen_shows_nothing_before_it_has_the_corrections_of_its_successor",
        ),
    ),
    Mutation(
        "a correction is acknowledged without another look at the epochs",
        "service/caesura_service/ownership/registry.py",
        "                self.ownership.check_current(station)\n",
        "                pass\n",
        (
            "tests/service/ownership/test_edits_of_two_instances.py::test_an_edit_is_not_acknowledged_where_another_instance_acquires_the_station_meanwhile",
        ),
    ),
    Mutation(
        "a change that was refused and yet recorded counts by the length of its copy",
        f"{JOURNAL}/copy_conflicts.py",
        "    if mine.owner_epoch >= counting.owner_epoch:\n",
        "    if True or mine.owner_epoch >= counting.owner_epoch:\n",
        (
            "tests/service/ownership/test_refused_records.py::test_a_refused_change_takes_no_acknowledged_one_away",
        ),
    ),
    Mutation(
        "a change is recorded before the takeover that it follows is in the journal",
        "service/caesura_service/ownership/station_ownership.py",
        "            (self._unmarked, self._own.store_takeover),\n",
        "",
        (
            "tests/service/ownership/test_refused_records.py::test_a_takeover_that_is_not_on_disk_yet_is_there_before_the_next_change",
        ),
    ),
    Mutation(
        "a takeover that was begun counts as completed",
        "service/caesura_service/ownership/station_ownership.py",
        "        self._unmarked.discard(station)\n        with",
        "        self._unmarked.add(station)\n        with",
        (
            "tests/service/ownership/test_refused_records.py::test_a_takeover_that_is_given_up_or_killed_leaves_the_acknowledged_change_to_the_next_one",
        ),
    ),
    Mutation(
        "an epoch that is stored late begins no other takeover",
        "service/caesura_service/ownership/station_ownership.py",
        "        is_late = station in self._unstored\n",
        "        is_late = False\n",
        (
            "tests/service/ownership/test_takeover_on_a_full_disk.py::test_an_owner_whose_epoch_could_not_be_stored_records_no_correction_without_it",
        ),
    ),
    Mutation(
        "another instance's journal that cannot be read just now counts as absent",
        f"{JOURNAL}/peer_journals.py",
        "        if now - since < UNREADABLE_S:\n",
        "        if now - since < 0.0:\n",
        (
            "tests/service/ownership/test_unreadable_peers.py::test_a_correction_that_cannot_be_read_is_not_replaced_by_the_next_one",
        ),
    ),
    Mutation(
        "a clock that is years ahead at a start deletes the journal",
        f"{JOURNAL}/retention.py",
        "        used = min(now - earlier, PAUSE_S)\n",
        "        used = now - earlier\n",
        (
            "tests/service/journal/test_retention.py::test_a_clock_that_is_years_ahead_at_a_start_costs_no_session",
        ),
    ),
    Mutation(
        "an array has an error for each of its items",
        "protocol/caesura_protocol/messages/field_types.py",
        "Listed = Annotated[tuple[T, ...], Field(fail_fast=True)]",
        "Listed = Annotated[tuple[T, ...], Field(fail_fast=False)]",
        (
            "tests/protocol/test_payload_unpack_limits.py::test_no_array_in_any_field_has_an_error_for_each_of_its_items",
        ),
    ),
    Mutation(
        "a takeover is done to its end before the next one begins",
        "service/caesura_service/ownership/takeovers_in_turns.py",
        "min(self._took_s, key=self._took_s.__getitem__)",
        "next(iter(self._took_s))",
        (
            "tests/service/ownership/test_takeovers_in_turns.py::"
            "test_a_short_takeover_is_done_while_a_long_one_that_began_before_goes_on",
        ),
    ),
    Mutation(
        "a start waits until all that is open is replayed",
        "service/caesura_service/server/station_manager.py",
        "most_s = START_S if served is None else inf",
        "most_s = inf",
        (
            "tests/service/server/test_fairness.py::"
            "test_a_start_does_not_wait_for_the_hours_that_one_station_has_open",
        ),
    ),
    Mutation(
        "a bridge evicts what no service has",
        "clients/caesura_clients/bridge/replay_ring.py",
        "self._entries[0].seq < self.acknowledged and ",
        "",
        ("tests/clients/test_replay_ring.py::test_what_no_service_is_known_to_have_is_kept_beyond_the_span",),
    ),
    Mutation(
        "the level of the force goes on from a rest",
        "service/caesura_service/changepoint/continued_level.py",
        "            log_q += log_presence(way @ way, self.away)\n",
        "",
        (
            "tests/service/changepoint/test_channel_model_checks.py::"
            "test_a_start_in_a_movement_costs_less_than_a_new_level_does",
        ),
    ),
    Mutation(
        "a change of the gripper counts as none",
        f"{SEGMENTATION}/observation_store.py",
        "self._changes += not math.isnan(self._state) and state != self._state",
        "self._changes += 0",
        (
            "tests/service/segmentation/test_observation_store.py::"
            "test_the_states_of_a_gripper_in_any_span_are_those_that_are_known_in_it",
        ),
    ),
)
