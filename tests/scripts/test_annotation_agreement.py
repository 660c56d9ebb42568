"""Agreement of annotators, against figures that are worked out by hand."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import pytest

TOP = Path(__file__).resolve().parents[2]


@pytest.fixture
def agreement(script):
    return script("annotation_agreement")


def document(points=(), segments=(), window=(0.0, 10.0)) -> dict:
    keys = ("t", "tol", "level")
    return {
        "window": list(window),
        "changepoints": [dict(zip(keys, point[:3], strict=True)) | dict(*point[3:]) for point in points],
        "segments": [dict(zip(("t0", "t1", "cls"), segment, strict=True)) for segment in segments],
    }


def test_two_equal_annotations_agree_fully(agreement):
    one = document([(1.0, 0.15, "major"), (2.0, 0.15, "optional")], [(0, 1, "steady"), (1, 10, "motion")])
    found = agreement.compare(one, one)
    assert (found.f1, found.strict_f1, found.median_s, found.kappa) == (1.0, 1.0, 0.0, 1.0)


def test_the_larger_tolerance_decides(agreement):
    one, other = document([(1.0, 0.15, "major")]), document([(1.25, 0.3, "major")])
    assert agreement.compare(one, other).f1 == agreement.compare(other, one).f1 == 1.0
    assert agreement.compare(one, document([(1.25, 0.2, "major")])).f1 == 0.0


def test_points_that_are_too_far_apart_to_agree_still_count_in_the_median(agreement):
    found = agreement.compare(document([(1.0, 0.1, "major")]), document([(1.4, 0.1, "major")]))
    assert (found.hits, found.lone) == (0, 2)
    assert found.median_s == pytest.approx(0.4)


def test_a_major_point_on_an_optional_one_is_excused_but_not_when_strict(agreement):
    one = document([(1.0, 0.15, "major"), (3.0, 0.15, "major")])
    other = document([(1.0, 0.15, "major"), (3.1, 0.15, "optional")])
    found = agreement.compare(one, other)
    assert (found.hits, found.lone, found.excused) == (1, 0, 1)
    assert found.f1 == 1.0
    assert found.strict_f1 == pytest.approx(2 / 3)


def test_one_point_agrees_with_one_point_only(agreement):
    found = agreement.compare(
        document([(1.0, 0.2, "major"), (1.1, 0.2, "major")]), document([(1.05, 0.2, "major")])
    )
    assert (found.hits, found.lone) == (1, 1)


def test_a_second_time_is_as_good_as_the_first(agreement):
    found = agreement.compare(
        document([(3.0, 0.15, "major", {"t_alt": 2.5})]), document([(2.5, 0.15, "major")])
    )
    assert (found.hits, found.median_s) == (1, 0.0)


def test_kappa_is_that_of_cohens_table(agreement):
    # 20 yes-yes, 5 yes-no, 10 no-yes, 15 no-no: observed 0.7, by chance 0.5
    pairs = [("y", "y")] * 20 + [("y", "n")] * 5 + [("n", "y")] * 10 + [("n", "n")] * 15
    assert agreement.kappa(pairs) == pytest.approx(0.4)
    assert math.isnan(agreement.kappa([("y", "y")] * 3))


def test_classes_are_compared_only_where_both_give_one(agreement):
    one = document(segments=[(0, 4, "steady"), (4, 8, "motion")])
    other = document(segments=[(2, 5, "steady"), (5, 10, "motion")])
    found = agreement.compare(one, other)
    assert len(found.classes) == pytest.approx(600, abs=1)
    assert found.labelled == pytest.approx(1000, abs=1)
    assert sum(a == b for a, b in found.classes) == pytest.approx(500, abs=1)


def test_the_published_figures_are_those_of_the_command(agreement, capsys):
    assert agreement.main([]) == 0
    rows = [re.split(r"\s{2,}|\s(?=\d|nan)", line.strip()) for line in capsys.readouterr().out.splitlines()]
    page = (TOP / "docs" / "annotation.md").read_text(encoding="utf-8")
    for row in rows[1:]:
        cells = [cell for cell in row if cell]
        assert "| " + " | ".join(cells).replace("nan", "–") + " |" in page


def test_directories_without_a_common_recording_are_named(agreement, tmp_path, capsys):
    assert agreement.main([str(tmp_path), str(tmp_path)]) == 1
    assert str(tmp_path) in capsys.readouterr().err


def test_the_file_of_every_second_annotation_is_the_first_annotators_file():
    for path in (TOP / "data" / "real" / "second").glob("*.ann.json"):
        first, second = (
            json.loads(each.read_text(encoding="utf-8")) for each in (TOP / "data" / "real" / path.name, path)
        )
        assert first["recording"]["sha256"] == second["recording"]["sha256"]
        assert first["annotator"] != second["annotator"]
