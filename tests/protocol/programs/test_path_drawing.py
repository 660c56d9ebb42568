"""The drawing of a path: two views at one scale, with its via points; a turn in place is a fan."""

from __future__ import annotations

from xml.etree import ElementTree as Xml

import pytest

from caesura_protocol.messages import App, AppPath, ViaPoint
from caesura_protocol.programs.path_drawing import path_svg
from harness.programs import DOWN, app, press

HALF, TURNED = (-0.38268343, 0.92387953, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0)


def moving(
    via: tuple[float, float, float], target: tuple[float, float, float], *, turns: bool = False
) -> App:
    start, between = (
        ViaPoint(t=t, position=place, orientation=orientation)
        for t, place, orientation in ((0.0, (0.3, 0.0, 0.3), DOWN), (1.0, via, HALF if turns else DOWN))
    )
    path = AppPath(
        start=start, via=(between,), tn=2.0, length_m=0.2, deviation_m=0.0, deviation_rad=0.0,
        tolerance_m=0.002, tolerance_rad=0.02,
    )  # fmt: skip
    return app("cartesian_motion", 0.0, 2.0, target, orientation=TURNED if turns else DOWN, path=path)


def test_a_way_around_a_corner_is_drawn_from_above_and_from_the_side_at_one_scale() -> None:
    drawing = Xml.fromstring(path_svg(moving((0.4, 0.0, 0.3), (0.4, 0.05, 0.35))))
    assert drawing.get("role") == "img"
    assert "1 via" in str(drawing.get("aria-label"))
    top, side = (line.attrib["points"].split() for line in drawing.iter("polyline"))
    ends = [[tuple(map(float, line[i].split(","))) for i in (0, -1)] for line in (top, side)]
    right, up = ends[0][1][0] - ends[0][0][0], ends[0][0][1] - ends[0][1][1]
    assert up == pytest.approx(right / 2, abs=0.2)  # 100 mm along x, 50 mm along y
    assert ends[1][0][1] - ends[1][1][1] == pytest.approx(up, abs=0.2)  # 50 mm along z
    assert len([one for one in drawing.iter("circle") if one.get("class") == "via"]) == 2  # one a view
    assert [one.text for one in drawing.iter("text")] == ["top x, y", "side x, z", "50 mm"]


def test_a_turn_in_place_is_a_fan_and_what_has_no_path_is_not_drawn() -> None:
    drawing = Xml.fromstring(path_svg(moving((0.3, 0.0, 0.3), (0.3, 0.0, 0.3), turns=True)))
    strokes = [one.attrib for one in drawing.iter("line")][:3]  # from above
    across = [float(one["x2"]) - float(one["x1"]) for one in strokes]
    up = [float(one["y1"]) - float(one["y2"]) for one in strokes]
    assert across == pytest.approx([0.0, -7.8, -11.0], abs=0.1)
    assert up == pytest.approx([-11.0, -7.8, 0.0], abs=0.1)
    assert path_svg(press()[0]) == ""
