"""Motions in words."""

from __future__ import annotations

from dqreg.solvers.motion_words import Motion, axis_words


def test_a_point_of_rounding_errors_alone_is_the_origin_once_the_size_is_known() -> None:
    point = (-4.441e-16, 0.0, -2.22e-16)
    assert axis_words(point, (0.0, 1.0, 0.0), "mm", 88.9) == "the axis through (0, 0, 0) mm along (0.00, 1.00, 0.00)"


def test_a_motion_names_its_unit_only_where_it_has_a_place() -> None:
    turn = Motion("rotation", (0.0, 0.0, 1.0), (1.0, 2.0, 3.0))
    assert turn.words == "rotation about the axis through (1, 2, 3) along (0.00, 0.00, 1.00)"
    assert turn.words_in("mm") == "rotation about the axis through (1, 2, 3) mm along (0.00, 0.00, 1.00)"
    shift = Motion("translation", (0.0, 0.0, 1.0), (1.0, 2.0, 3.0))
    assert shift.words_in("mm") == shift.words == "translation along (0.00, 0.00, 1.00)"
