"""Stated probability against the share that was right, on cases small enough to count by hand."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import typer
from scipy.stats import norm
from typer.testing import CliRunner

from caesura_lab.commands import register
from caesura_lab.evaluation.methods import PresetMethod
from caesura_lab.evaluation.reports.calibration import EDGES, calibrate, curve, share
from caesura_lab.evaluation.reports.calibration import as_json as plain
from caesura_lab.evaluation.reports.reliability_diagram import draw
from caesura_lab.evaluation.runner import NotApplicable
from caesura_lab.evaluation.scoring.score import FoundSegment, FoundSegmentation, StatedProbability, score
from caesura_lab.ground_truth import TrueChangepoint, TrueSegment, Truth
from caesura_protocol.formats.read import load_recording
from caesura_service.offline_segmentation import segment_recording

BUTTON = Path(__file__).parents[3] / "data" / "button.npz"


def run(*arguments: object):
    app = typer.Typer()
    register(app)
    return CliRunner().invoke(app, ["evaluate", *map(str, arguments)])


def changepoints(*pairs: tuple[float, bool]) -> list[StatedProbability]:
    return [StatedProbability(probability, float(right), 1.0) for probability, right in pairs]


def in_bins(statements: list[StatedProbability]) -> dict[tuple[float, float], int]:
    return {(b.low, b.high): b.share.n for b in curve(statements).bins if b.share.n}


def test_a_bin_has_its_lower_edge_and_the_last_one_both():
    stated = changepoints((0.2, True), (0.5, True), (0.95, True), (0.9499, True), (0.99, False), (1.0, True))
    assert in_bins(stated) == {
        (0.0, 0.5): 1,
        (0.5, 0.6): 1,
        (0.9, 0.95): 1,
        (0.95, 0.99): 1,
        (0.99, 1.0): 2,
    }


def test_the_bins_are_the_ones_that_are_asked_for():
    assert EDGES == (0.0, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0)


def test_brier_and_calibration_error_by_hand():
    one = curve(changepoints((0.9, True), (0.92, False), (0.55, True), (0.55, False)))
    assert one.brier == pytest.approx((0.1**2 + 0.92**2 + 0.45**2 + 0.55**2) / 4)
    assert one.ece == pytest.approx((2 * abs(0.91 - 0.5) + 2 * abs(0.55 - 0.5)) / 4)
    assert (one.n, one.weight) == (4, 4.0)


def test_the_furthest_bin_has_cases_enough_and_lies_above_one_half():
    low = [(0.3, True)] * 50
    few = [(0.75, False)] * 29
    near = [(0.65, i < 24) for i in range(40)]
    far = [(0.97, i < 27) for i in range(30)]
    worst = curve(changepoints(*low, *few, *near, *far)).furthest
    assert worst is not None
    assert (worst.low, worst.high) == (0.95, 0.99)
    assert worst.distance == pytest.approx(0.97 - 0.9)
    assert curve(changepoints(*low, *few)).furthest is None
    more = curve(changepoints(*few, (0.75, False))).furthest
    assert more is not None
    assert more.distance == pytest.approx(0.75)


def test_classes_are_weighted_by_time():
    one = curve([StatedProbability(0.8, 3.0, 4.0), StatedProbability(0.85, 0.0, 1.0)])
    (found,) = [b for b in one.bins if b.share.n]
    assert found.stated == pytest.approx((0.8 * 4 + 0.85) / 5)
    assert found.share.right == pytest.approx(3 / 5)
    assert found.weight == 5.0
    assert one.brier == pytest.approx((3 * 0.2**2 + 1 * 0.8**2 + 1 * 0.85**2) / 5)
    # 25 / 17 cases: one long segment is hardly more than one case.
    assert (found.share.low, found.share.high) == pytest.approx(wilson(0.6, 25 / 17))


def wilson(p: float, n: float) -> tuple[float, float]:
    """The shares q whose test |p − q| ≤ z √(q (1 − q) / n) does not reject, by a fine grid."""
    q = np.linspace(0.0, 1.0, 2_000_001)
    kept = q[np.abs(p - q) <= norm.ppf(0.975) * np.sqrt(q * (1 - q) / n)]
    return pytest.approx(kept[0], abs=1e-5), pytest.approx(kept[-1], abs=1e-5)


@pytest.mark.parametrize(("right", "of"), [(0, 5), (5, 5), (47, 100), (1, 3)])
def test_an_interval_holds_every_share_that_is_not_rejected(right: int, of: int):
    one = share(right, of, of)
    low, high = wilson(right / of, of)
    assert one.low == low
    assert one.high == high


def test_honest_statements_are_calibrated_and_boastful_ones_are_not():
    rng = np.random.default_rng(0)
    stated = rng.uniform(0.5, 1.0, 20_000)
    right = rng.uniform(size=stated.size) < stated
    honest = curve(changepoints(*zip(stated, right, strict=True)))
    boastful = curve(changepoints(*zip(np.sqrt(stated), right, strict=True)))
    assert honest.ece < 0.02
    assert boastful.ece > 0.08
    assert honest.brier < boastful.brier


def test_without_statements_there_is_no_number():
    one = curve([])
    assert math.isnan(one.brier)
    assert math.isnan(one.ece)
    assert (one.n, {b.share.n for b in one.bins}) == (0, {0})


TRUTH = Truth(
    name="one",
    window=(0.0, 10.0),
    points=(TrueChangepoint(2.0, 0.1), TrueChangepoint(5.0, 0.1, optional=True), TrueChangepoint(8.0, 0.1)),
    spans=(TrueSegment(0, 2, "steady"), TrueSegment(2, 8, "motion")),
)
TIMES = (0.1, 2.0, 5.0, 6.0)
PARTS = (
    FoundSegment(0, 2, "steady", probability=0.9),
    FoundSegment(2, 6, "motion", probability=0.8),
    FoundSegment(6, 9, "steady", probability=0.6),
    FoundSegment(9, 10, "motion", probability=0.7),
)


def test_what_is_excused_is_no_case():
    probabilities = dict(zip(TIMES, (0.5, 0.6, 0.7, 0.8), strict=True))
    one = score("mine", TRUTH, FoundSegmentation(TIMES, PARTS, probabilities=probabilities))
    assert sorted(one.stated_points) == [(0.6, 1.0, 1.0), (0.8, 0.0, 1.0)]


def test_a_segment_is_a_case_as_long_as_its_class_is_known():
    one = score("mine", TRUTH, FoundSegmentation(TIMES, PARTS))
    assert one.stated_points == ()
    assert one.stated_classes == ((0.9, 2.0, 2.0), (0.8, 4.0, 4.0), (0.6, 0.0, 2.0))


def test_the_method_states_what_the_view_states():
    recording = load_recording(BUTTON)
    found, view = PresetMethod("default").segment(recording), segment_recording(recording, "default")
    assert found.probabilities == {one.t: one.probability for one in view.changepoints}
    assert [part.probability for part in found.parts] == [one.probability for one in view.segments]
    assert len(found.probabilities) > 5


def calibrated(slacks: tuple[float, ...] = (0.0, 0.2)):
    stated = {2.0: 0.6, 6.0: 0.8}
    found = FoundSegmentation((2.0, 6.0), PARTS, intervals={2.0: (1.9, 2.2)}, probabilities=stated)
    scores = [score("mine", TRUTH, found)] * 3
    verdicts = [replace(one, slack_s=slack) for one in scores for slack in slacks]
    return calibrate(
        "title", ["mine", "absent"], [*verdicts, NotApplicable("other", "one", "reason")], ["gone"]
    )


def test_every_slack_has_its_own_curve_and_notes_are_kept():
    result = calibrated()
    mine = [one for one in result.calibrations if one.method == "mine"]
    assert [one.slack_s for one in mine] == [0.0, 0.2]
    assert mine[0].changepoints.n == 6
    assert mine[0].within.right == 1.0
    assert mine[0].interval_s == pytest.approx(0.3)
    assert result.notes == ("other is not applicable to one: reason", "gone")
    assert json.loads(json.dumps(plain(result), allow_nan=False))["notes"][1] == "gone"


def test_the_diagram_shows_each_bin_at_its_share():
    figure = draw(calibrated())
    upper = figure.axes[:3]
    assert [axes.get_title() for axes in upper] == [
        "changepoints, no slack",
        "changepoints, 0.2 s of slack",
        "classes of segments",
    ]
    shown = [line for line in upper[0].lines if line.get_label() == "mine"]
    assert shown[0].get_xdata() == pytest.approx([0.6, 0.8])
    assert shown[0].get_ydata() == pytest.approx([1.0, 0.0])


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["svg", "png"])
def test_the_command_prints_tables_and_draws(tmp_path: Path, suffix: str):
    file = tmp_path / f"reliability.{suffix}"
    result = run("--calibration", BUTTON, "--diagram", file)
    assert result.exit_code == 0, result.output
    for text in ("changepoints by stated probability; no slack", "0.2 s of slack", "Brier", "0.99–1"):
        assert text in result.stdout
    assert "thresholds" not in result.stdout
    assert max(map(len, result.stdout.splitlines())) <= 80
    assert file.read_bytes()[:5] in (b"<?xml", b"\x89PNG\r")


def test_json_has_the_bins(tmp_path: Path):
    out = tmp_path / "out.json"
    result = run(
        "--calibration",
        BUTTON,
        "--preset",
        "default",
        "--preset",
        "integrated",
        "--format",
        "json",
        "-o",
        out,
    )
    assert result.exit_code == 0, result.output
    methods = json.loads(out.read_text())["methods"]
    assert [(one["method"], one["slack_s"]) for one in methods] == [
        ("default", 0.0),
        ("default", 0.2),
        ("integrated", 0.0),
        ("integrated", 0.2),
    ]
    assert [one["high"] for one in methods[0]["changepoints"]["bins"]] == list(EDGES[1:])


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ((BUTTON, "--diagram", "x.svg"), "add --calibration"),
        ((BUTTON, "--calibration", "--diagram", "x.jpg"), "expected one of .svg, .png, .pdf"),
        ((BUTTON, "--calibration", "--diagram", "/nowhere/x.svg"), "cannot write"),
        (("--calibration",), "either files or one --suite"),
        (
            ("--calibration", "--suite", "thesis"),
            "a suite of teacher, skills, hand, estimates, movements, tasks, repetitions, real, sensors, "
            "tempo, windows, starts",
        ),
        ((BUTTON, "--calibration", "--ablate"), "without --ablate"),
    ],
)
def test_misuse_is_one_line(arguments: tuple, expected: str):
    result = run(*arguments)
    assert result.exit_code == 1
    assert expected in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
