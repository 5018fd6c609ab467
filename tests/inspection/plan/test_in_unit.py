from __future__ import annotations

import dataclasses
import tomllib
from typing import Any

import pytest

from dqreg.inspection.plan.file import plan_of
from dqreg.inspection.plan.in_unit import plan_in

TEXT = """
units = "mm"
tolerance = 10
expected_deviation = 50
required = 90
[[datum]]
name = "A"
near = [10, 20, 30]
[[datum]]
name = "B"
face = 7
[[face]]
box = [0, 0, 0, 10, 10, 10]
plus = 20
minus = 10
[[section]]
point = [10, 0, 0]
normal = [0, 0, 5]
[[alignment]]
kind = "best-fit"
faces = [3, 4]
weights = [5, 6]
plus = 10
minus = 20
prior = {rotation = 5, translation = 10}
[[alignment]]
kind = "points"
points = [[10, 20, 30], [10, 20, 30, 0, 0, 5]]
[[characteristic]]
kind = "distance"
faces = [1, [10, 20, 30]]
nominal = 30
tolerance = 10
[[characteristic]]
kind = "angle"
faces = [1, 2]
nominal = 90
tolerance = 5
[[characteristic]]
kind = "angularity"
face = 2
datum = "B"
tolerance = 10
[[characteristic]]
kind = "edge-point"
point = [10, 20, 30]
tolerance = 10
[[characteristic]]
kind = "straightness"
face = 2
at = [10, 20, 30]
direction = [5, 0, 0]
tolerance = 10
[[characteristic]]
kind = "profile"
face = 2
plus = 30
minus = 10
"""
# Numbers of the plan above that are no lengths, and 0.
KEPT = {0.0, 0.9, 5.0, 6.0, 90.0}


def numbers(value: Any) -> list[float]:
    """Every number of a plan that is no count, in order."""
    if dataclasses.is_dataclass(value):
        return [x for field in dataclasses.fields(value) for x in numbers(getattr(value, field.name))]
    if isinstance(value, tuple):
        return [x for each in value for x in numbers(each)]
    return [value] if isinstance(value, float) else []


def test_all_lengths_of_a_plan_change_and_nothing_else() -> None:
    plan = plan_of(tomllib.loads(TEXT))
    shown = plan_in(plan, "cm")
    assert shown.units == "cm"
    before = numbers(plan)
    assert set(before) > KEPT
    assert numbers(shown) == pytest.approx([x if x in KEPT else x / 10.0 for x in before], rel=1e-12)
    # Numbers of faces, names and kinds stay.
    assert shown.datums[1].face == 7
    assert shown.characteristics[0].faces == (1, (1.0, 2.0, 3.0))


def test_a_plan_stays_where_a_unit_is_not_known() -> None:
    plan = plan_of(tomllib.loads(TEXT))
    bare = dataclasses.replace(plan, units=None)
    assert plan_in(plan, None) is plan
    assert plan_in(plan, "mm") is plan
    assert plan_in(bare, "inch") is bare
