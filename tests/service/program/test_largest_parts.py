"""The largest parts of a note: named in their order, and the others counted."""

from __future__ import annotations

from caesura_service.program.notes.largest_parts import largest_parts


def named(sizes, most):
    return list(largest_parts(sizes, float, str, most, "others"))


def test_the_largest_are_named_in_their_order_and_the_others_counted():
    assert named([3, 1, 4, 2], 2) == ["3", "4", "2 others"]
    assert named([3, 1], 2) == ["3", "1"]


def test_of_equal_parts_no_more_are_named_than_were_asked_for():
    assert named([5, 5, 5], 2) == ["5", "5", "1 others"]
