"""One recording's score, and many made into numbers with intervals."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from caesura_lab.evaluation.reports.error_analysis import error_summary
from caesura_lab.evaluation.reports.report import format_estimate, report
from caesura_lab.evaluation.reports.tables import as_markdown
from caesura_lab.evaluation.scoring.metrics import TimedEstimate
from caesura_lab.evaluation.scoring.score import FoundSegment, FoundSegmentation, score
from caesura_lab.evaluation.scoring.summary import margins, summarise
from caesura_lab.ground_truth import (
    MeasuredQuantity,
    ScrewStroke,
    ToleranceOptions,
    TrueChangepoint,
    TrueSegment,
    Truth,
)

TRUTH = Truth(
    name="one",
    window=(0.0, 10.0),
    points=(
        TrueChangepoint(2.0, 0.1, kind="start"),
        TrueChangepoint(4.0, 0.1, kind="contact_on"),
        TrueChangepoint(5.0, 0.1, optional=True, kind="dip"),
        TrueChangepoint(8.0, 0.1, kind="stop"),
    ),
    spans=(
        TrueSegment(0, 2, "steady"),
        TrueSegment(2, 4, "motion"),
        TrueSegment(4, 8, "transport"),
        TrueSegment(8, 10, "hold"),
    ),
    loads=(MeasuredQuantity(4.0, 10.0, 0.3),),
    forces=(MeasuredQuantity(2.0, 4.0, 12.0),),
)
PARTS = (
    FoundSegment(0.05, 2.0, "steady", force_n=0.1),
    FoundSegment(2.0, 4.0, "contact", force_n=10.0),
    FoundSegment(4.0, 8.0, "transport", load_kg=0.2, force_n=2.0),
    FoundSegment(8.0, 9.9, "hold", load_kg=0.5, force_n=5.0),
)


def test_all_that_is_right_and_wrong_is_counted():
    found = FoundSegmentation((0.0, 2.05, 5.0, 6.0, 8.15, 10.5), PARTS)
    one = score("mine", TRUTH, found)
    assert (one.hits, one.false_alarms, one.misses) == (1, 2, 2)
    assert one.cut == (2, 4)
    assert one.merged == (2, 4)
    assert [hit.kind for hit in one.found] == ["start"]
    assert one.found[0].offset_s == pytest.approx(0.05)
    assert [(miss.kind, miss.between) for miss in one.missed] == [
        ("contact_on", "motion → transport"),
        ("stop", "transport → hold"),
    ]
    assert one.missed[0].offset_s is None
    assert one.missed[1].offset_s == pytest.approx(0.15)
    assert [alarm.within for alarm in one.alarms] == ["transport", "hold"]


def test_boundaries_between_phases_are_counted_within_half_a_second():
    phased = replace(
        TRUTH, phases=(TrueSegment(0, 3, "reach"), TrueSegment(3, 7, "wipe"), TrueSegment(7, 10, "retract"))
    )
    one = score("mine", phased, FoundSegmentation((), phases=(0.1, 3.5, 5.0, 7.6)))
    assert (one.phase_hits, one.phase_misses, one.phase_false_alarms) == (1, 1, 2)
    assert summarise([one])["phase_f1"].value == pytest.approx(2 / 5)
    unphased = score("mine", TRUTH, FoundSegmentation((), phases=(3.0,)))
    assert summarise([unphased])["phase_f1"].n == 0, "nothing is judged without true phases"
    assert summarise([score("mine", phased, FoundSegmentation(()))])["phase_f1"].n == 0, (
        "nor without found ones"
    )


def test_a_screw_is_read_from_the_part_that_shares_most_of_its_stroke():
    stroke = ScrewStroke(4.0, 8.0, (0.0, 0.0, -1.0), 0.0015)
    found = FoundSegmentation(
        (),
        (
            FoundSegment(0.0, 4.5, "turning", force_n=1.0, screw=((1.0, 0.0, 0.0), 0.1)),
            FoundSegment(4.5, 8.0, "turning", force_n=1.0, screw=((0.0, 0.6, -0.8), 0.0012)),
            FoundSegment(8.0, 10.0, "contact", force_n=1.0),
        ),
    )
    one = score(
        "mine", replace(TRUTH, screws=(stroke, ScrewStroke(9.0, 9.5, (0.0, 0.0, -1.0), 0.0015))), found
    )
    assert one.axis_errors_deg == pytest.approx((math.degrees(math.acos(0.8)),))
    assert one.pitch_errors == pytest.approx((0.2,))
    shown = summarise([one])
    assert shown["screws_found"].value == 0.5, "the second one is in no part"
    assert shown["pitch_error"].value == pytest.approx(0.2)
    assert summarise([score("mine", TRUTH, found)])["screws_found"].n == 0, (
        "without a screw nothing is judged"
    )


def test_a_floor_widens_what_is_narrower():
    found = FoundSegmentation((2.05, 4.0, 8.15), PARTS)
    assert score("mine", TRUTH, found).hits == 2
    assert score("mine", ToleranceOptions(least_s=0.2).apply_to(TRUTH), found).hits == 3


def test_what_a_filter_needs_at_the_beginning_is_not_held_against_it():
    one = score("mine", TRUTH, FoundSegmentation((2.0, 4.0, 8.0), PARTS))
    assert ("steady", "none") not in one.confusion
    assert one.confusion["motion", "contact"] == 2.0
    assert one.confusion_inside["steady", "steady"] == pytest.approx(1.9)


def test_loads_are_weighed_by_time_and_forces_by_the_largest():
    one = score("mine", TRUTH, FoundSegmentation((2.0, 4.0, 8.0), PARTS))
    assert one.load_errors_kg == pytest.approx([(4 * 0.2 + 2 * 0.5) / 6 - 0.3], abs=1e-9)
    assert one.force_errors_n == pytest.approx([2.0])
    assert (one.loads, one.forces) == (1, 1)


def test_a_method_that_measures_nothing_is_not_asked_for_it():
    parts = tuple(FoundSegment(part.t0, part.t1, part.kind) for part in PARTS)
    one = score("mine", TRUTH, FoundSegmentation((2.0,), parts))
    assert (one.loads, one.forces) == (0, 0)


def test_delays_are_from_the_truth_to_when_it_was_said_for_good():
    timed_estimates = (TimedEstimate(2.3, (2.05,), (False,)), TimedEstimate(3.0, (2.05,), (True,)))
    one = score("mine", TRUTH, FoundSegmentation((2.05,), None, timed_estimates))
    assert one.provisional_s == pytest.approx([0.3])
    assert one.final_s == pytest.approx([1.0])
    assert one.withdrawn == (0, 1)
    assert not one.confusion


def test_a_summary_has_an_interval_about_its_value_and_is_the_same_each_time():
    good, bad = (score("mine", TRUTH, FoundSegmentation(times, PARTS)) for times in ((2.0, 4.0, 8.0), (1.0,)))
    people = [replace(one, subject=name) for one, name in ((good, "a"), (good, "b"), (bad, "c"))]
    numbers = summarise(people)
    recall = numbers["recall"]
    assert recall.value == pytest.approx(6 / 9)
    assert 0.0 <= recall.low <= recall.value <= recall.high <= 1.0
    assert repr(summarise(people)) == repr(numbers)  # nan is no equal of itself
    assert summarise([good, good])["f1"].value == 1.0


def test_one_subject_has_no_interval():
    """All resamples of it are the same, so 0.67…0.67 stood below its value as a 95 % interval."""
    one = score("mine", TRUTH, FoundSegmentation((2.0, 4.0), PARTS))
    for numbers in (summarise([one, one]), margins([one], [one])):
        recall = numbers["recall"]
        assert math.isfinite(recall.value)
        assert math.isnan(recall.low)
        assert math.isnan(recall.high)
    assert format_estimate(summarise([one])["recall"], 2) == ("0.67", "")


def test_a_margin_is_taken_recording_by_recording():
    truths = [replace(TRUTH, name=name) for name in "abcd"]
    times = [(2.0,), (2.0, 4.0), (2.0, 4.0, 8.0), (2.0,)]
    own = [
        score("own", truth, FoundSegmentation((*found, 7.0)))
        for truth, found in zip(truths, times, strict=True)
    ]
    others = [
        score("others", truth, FoundSegmentation(found)) for truth, found in zip(truths, times, strict=True)
    ]
    recall = margins(own, others[::-1])["recall"]
    assert (recall.value, recall.low, recall.high) == (0.0, 0.0, 0.0)
    precision = margins(own, others)["precision"]
    assert precision.high < 0.0


def test_what_an_optional_point_excuses_is_counted_and_a_false_alarm_of_the_strict_f1():
    alone, excused, edge = (
        score("mine", TRUTH, FoundSegmentation(times))
        for times in ((2.0, 4.0, 8.0), (2.0, 4.0, 5.0, 8.0), (0.1, 2.0, 4.0, 8.0))
    )
    assert [one.excused for one in (alone, excused, edge)] == [0, 1, 0]
    numbers = summarise([excused])
    assert (numbers["f1"].value, numbers["precision"].value, numbers["recall"].value) == (1.0, 1.0, 1.0)
    assert (numbers["excused"].value, numbers["strict_f1"].value) == (0.25, pytest.approx(6 / 7))


def test_the_share_that_is_found_is_shown_by_kind():
    few, all_three = (
        score(name, TRUTH, FoundSegmentation(times, PARTS))
        for name, times in (("few", (2.0,)), ("all", (2.0, 4.0, 8.0)))
    )
    page = as_markdown(report("one", ["few", "all"], [few, all_three]))
    kinds = page.split("share of points that are found, by kind (and number); no slack\n\n")[1].splitlines()
    assert kinds[0] == "| method | start (1) | contact_on (1) | stop (1) |"
    assert kinds[2:4] == ["| few | 1.00 | 0.00 | 0.00 |", "| all | 1.00 | 1.00 | 1.00 |"]


def test_intervals_resample_subjects_and_not_their_recordings():
    good, bad = (score("mine", TRUTH, FoundSegmentation(times)) for times in ((2.0, 4.0, 8.0), (1.0,)))
    people = [replace(one, subject=f"person {i}") for i, one in enumerate([good, bad] * 4)]
    repeated = [replace(one, recording=f"{k}: {one.subject}") for one in people for k in range(5)]
    one_each, five_each = summarise(people)["recall"], summarise(repeated)["recall"]
    assert five_each == replace(one_each, n=5 * one_each.n)
    nothing = [replace(one, method="other", hits=0, misses=3) for one in repeated]
    assert margins(repeated, nothing)["recall"] == five_each


def test_without_any_there_is_no_number():
    numbers = summarise([score("mine", TRUTH, FoundSegmentation(()))])
    for name in ("precision", "class", "provisional_median", "load_error"):
        assert math.isnan(numbers[name].value)
    assert numbers["f1"].value == 0.0


def test_typical_errors_come_most_frequent_first():
    wrong = score("mine", TRUTH, FoundSegmentation((2.0, 4.3, 6.0, 7.0), PARTS))
    typical = error_summary([wrong, wrong])
    assert [(m.kind, m.missed, m.of_kind, m.near) for m in typical.missed] == [
        ("contact_on", 2, 2, 2),
        ("stop", 2, 2, 2),
    ]
    assert typical.missed[0].offset_s == pytest.approx(0.3)
    assert typical.invented[0].times >= typical.invented[-1].times
    assert typical.confusion["motion", "contact"] == 4.0
